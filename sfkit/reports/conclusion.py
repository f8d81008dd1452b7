"""What a notebook concludes: a report's title, and the box below it; in Jupyter a list."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nbformat import NotebookNode

MIME = "application/vnd.sfkit.conclusion+json"


@dataclass(frozen=True)
class Conclusion:
    """The answer to a notebook's question, shown first on its report whichever cell displays it.

    Attributes:
        title: the answer in one sentence of plain text.
        sentences: what it rests on, one thought each.
    """

    title: str
    sentences: tuple[str, ...] = ()

    @classmethod
    def of(cls, sentences: Iterable[str]) -> Conclusion:
        """The first sentence is the title; asterisks that make text bold are taken off."""
        title, *rest = (sentence.replace("**", "") for sentence in sentences)
        return cls(title, tuple(rest))

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, Any]:
        """For a page, and as Markdown for whoever reads the notebook itself."""
        listed = "\n".join(f"- {sentence}" for sentence in (f"**{self.title}**", *self.sentences))
        return {
            MIME: {"title": self.title, "sentences": list(self.sentences)},
            "text/markdown": listed,
            "text/plain": " ".join((self.title, *self.sentences)),
        }


def take_conclusion(notebook: NotebookNode) -> Conclusion | None:
    """The last conclusion a notebook displays, taken out of its cells; None where it has none."""
    found = None
    for cell in notebook.cells:
        for output in list(cell.get("outputs", [])):
            stated = output.get("data", {}).get(MIME)
            if isinstance(stated, dict) and isinstance(stated.get("title"), str):
                # Of several the last one counts.
                found = Conclusion(stated["title"], tuple(map(str, stated.get("sentences", ()))))
                cell.outputs.remove(output)
    return found
