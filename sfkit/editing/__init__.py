"""Editing a recipe by hand: drafts that stay on the simplex, and what was looked at while editing."""

from sfkit.editing.drafts import GAMMA, EditHistory, RoutingDraft
from sfkit.editing.hand_edits import SeenByHand, mark_hand_edit, seen_by_hand
