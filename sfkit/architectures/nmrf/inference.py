"""Neural MRF inference at 1/8 resolution and refinement at 1/4 (NMRF, CVPR 2024), both by messages.

Messages go between a pixel's candidates, and within windows. Tokens are (B, h, w, N, c): N candidates a
pixel. ``code`` (B, h, w, N, 31) is the candidates' disparity code; it is computed once and joins the tokens
in every layer.
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.nmrf import windows
from sfkit.architectures.nmrf.layers import EIGHTH_UNIT, LENGTH, QUARTER_UNIT, FeedForward, disparity_code
from sfkit.architectures.nmrf.matching import UNARY_WIDTH, MatchingFeatures
from sfkit.architectures.portable import is_portable

HEADS = 4


class CandidateMessages(nn.Module):
    """Attention among the candidates of one pixel; no feed-forward block."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm1 = nn.LayerNorm(width)
        self.q = nn.Linear(width + LENGTH, width)
        self.k = nn.Linear(width + LENGTH, width)
        self.v = nn.Linear(width, width)
        self.proj = nn.Linear(width, width)

    def forward(self, x: torch.Tensor, code: torch.Tensor) -> torch.Tensor:
        """Tokens and code -> tokens, (B, h, w, N, c)."""
        t = self.norm1(x)
        with_code = torch.cat((t, code.to(t.dtype)), -1)
        q, k, v = (
            y.reshape(*y.shape[:-1], HEADS, -1).transpose(-2, -3)
            for y in (self.q(with_code), self.k(with_code), self.v(t))
        )
        logits = (q * q.shape[-1] ** -0.5) @ k.transpose(-1, -2)
        out = (logits.softmax(-1) @ v).transpose(-2, -3).flatten(-2)
        y: torch.Tensor = x + self.proj(out)
        return y


class RelativeAttention(nn.Module):
    """Attention between all candidates of a window; keys, queries and values know the relative position.

    logit_ij = s (q_i k_j + q_i ke_ij + k_j qe_ij), out_i = sum_j softmax_j (v_j + ve_ij). The encodings
    depend on the two pixels only, so their terms are computed per pair of pixels and spread over candidates.
    """

    relative_position_index: torch.Tensor

    def __init__(self, width: int, window: int) -> None:
        super().__init__()
        self.relative_position_enc_table = nn.Parameter(torch.zeros((2 * window - 1) ** 2, 3 * width))
        nn.init.trunc_normal_(self.relative_position_enc_table, std=0.02)
        self.register_buffer("relative_position_index", windows.relative_position_index(window))

    def forward(self, qkv: torch.Tensor, strangers: torch.Tensor | None) -> torch.Tensor:
        """Messages inside each window; different candidates of one pixel get no messages from each other.

        Args:
            qkv: (B, windows, T, N, 3 c).
            strangers: (windows, T, T), -inf between different regions of a shifted window, else 0.

        Returns:
            (B, windows, T, N, c).
        """
        batch, count, T, N, _ = qkv.shape
        heads = qkv.reshape(batch * count, T, N, 3, HEADS, -1).permute(3, 4, 0, 1, 2, 5)
        q, k, v = heads.unbind(0)  # (heads, windows, T, N, c)
        q = q * q.shape[-1] ** -0.5
        query_code, key_code, value_code = self._encodings()
        # (heads, T, windows * N, c) @ (heads, T, c, T): the query's, or key's, own position leads.
        by_query = self._per_position(q) @ key_code.transpose(-1, -2)
        by_key = self._per_position(k * k.shape[-1] ** -0.5) @ query_code.permute(0, 2, 3, 1)
        by_query = by_query.reshape(HEADS, T, -1, N, T).permute(0, 2, 1, 3, 4)
        by_key = by_key.reshape(HEADS, T, -1, N, T).permute(0, 2, 4, 1, 3)
        if strangers is not None:
            by_query = by_query + strangers.repeat(batch, 1, 1)[:, :, None]
        # The logits are by far the largest tensor here: everything is added to them in place.
        logits = q.flatten(2, 3) @ k.flatten(2, 3).transpose(-1, -2)
        logits = logits.reshape(HEADS, -1, T, N, T, N).add_(by_query[..., None]).add_(by_key[:, :, :, None])
        rivals = ~torch.eye(N, dtype=torch.bool, device=logits.device)
        if is_portable():  # exporters know no writing to a diagonal
            own = torch.eye(T, dtype=torch.bool, device=logits.device)[:, None, :, None]
            logits = logits.masked_fill(own & rivals[:, None], -math.inf)
        else:
            logits.diagonal(dim1=2, dim2=4).masked_fill_(rivals[:, :, None], -math.inf)
        weights = logits.flatten(-2).softmax(-1)
        out = weights.flatten(2, 3) @ v.flatten(2, 3)
        by_position = self._per_position(weights.reshape(logits.shape).sum(-1)) @ value_code
        out = out.reshape(v.shape) + by_position.reshape(HEADS, T, -1, N, v.shape[-1]).transpose(1, 2)
        messages: torch.Tensor = out.permute(1, 2, 3, 0, 4).reshape(batch, count, T, N, -1)
        return messages

    def _encodings(self) -> tuple[torch.Tensor, ...]:
        """Three (heads, T, T, c): for queries, keys, values. In the table the heads are outermost."""
        rows = self.relative_position_enc_table[self.relative_position_index]
        return rows.reshape(*rows.shape[:2], HEADS, 3, -1).permute(3, 2, 0, 1, 4).unbind(0)

    @staticmethod
    def _per_position(x: torch.Tensor) -> torch.Tensor:
        """(heads, windows, T, N, c) -> (heads, T, windows * N, c)."""
        return x.transpose(1, 2).flatten(2, 3)


class WindowMessages(nn.Module):
    """Pre-norm messages inside windows, shifted by half a window in every second layer."""

    def __init__(self, width: int, window: int, shifted: bool) -> None:
        super().__init__()
        self.window = window
        self.shift = window // 2 if shifted else 0
        self.qkv = nn.Linear(width + LENGTH, 3 * width)
        self.norm1 = nn.LayerNorm(width)
        self.attn = RelativeAttention(width, window)
        self.proj = nn.Linear(width, width)
        self.norm2 = nn.LayerNorm(width)
        self.mlp = FeedForward(width, 4 * width, width)

    def forward(self, x: torch.Tensor, code: torch.Tensor, strangers: torch.Tensor) -> torch.Tensor:
        """Tokens and code -> tokens, (B, h, w, N, c), h and w multiples of the window."""
        height, width = x.shape[1:3]
        t = self.norm1(x)
        t = torch.cat((t, code.to(t.dtype)), -1)
        if self.shift:
            t = t.roll((-self.shift, -self.shift), (1, 2))
        # Cut first, project second: the same, and less to move.
        tiles = self.attn(self.qkv(windows.cut(t, self.window)), strangers if self.shift else None)
        out = windows.join(tiles, self.window, height, width)
        if self.shift:
            out = out.roll((self.shift, self.shift), (1, 2))
        x = x + self.proj(out)
        y: torch.Tensor = x + self.mlp(self.norm2(x))
        return y


class MessageLayer(nn.Module):
    """A layer as the state dict names it; ``self_nmp`` only where a pixel has several candidates."""

    def __init__(self, width: int, window: int, shifted: bool, candidates: int) -> None:
        super().__init__()
        self.self_nmp = CandidateMessages(width) if candidates > 1 else None
        self.nmp = WindowMessages(width, window, shifted)

    def forward(self, x: torch.Tensor, code: torch.Tensor, strangers: torch.Tensor) -> torch.Tensor:
        """Tokens and code -> tokens, (B, h, w, N, c)."""
        if self.self_nmp is not None:
            x = self.self_nmp(x, code)
        y: torch.Tensor = self.nmp(x, code, strangers)
        return y


class MessageStack(nn.Module):
    """Layers of messages over a grid that is zero-padded, evenly on both sides, to whole windows.

    Padded tokens take part like any other; they are cropped away at the end.
    """

    def __init__(self, width: int, window: int, layers: int, candidates: int) -> None:
        super().__init__()
        self.window = window
        self.ffn = FeedForward(UNARY_WIDTH, width, width)
        self.layers = nn.ModuleList(
            MessageLayer(width, window, shifted=i % 2 == 1, candidates=candidates) for i in range(layers)
        )
        self.norm = nn.LayerNorm(width)

    def pass_messages(self, unary: torch.Tensor, code: torch.Tensor) -> list[torch.Tensor]:
        """Exchange messages.

        Args:
            unary: (B, h, w, N, 160), what each candidate looks like.
            code: (B, h, w, N, 31), the candidates' disparity code.

        Returns:
            Normalised tokens (B, h, w, N, c): of every layer in training, else of the last alone.
        """
        height, width = unary.shape[1:3]
        down, across = (windows.whole(n, self.window) - n for n in (height, width))
        top, left = down // 2, across // 2
        bottom, right = down - top, across - left
        x, code = (F.pad(y, (0, 0, 0, 0, left, right, top, bottom)) for y in (self.ffn(unary), code))
        strangers = self._strangers(x)
        outputs = []
        for i, layer in enumerate(self.layers):
            x = layer(x, code, strangers)
            # Training has a loss on every layer, inference reads the last one.
            if self.training or i == len(self.layers) - 1:
                outputs.append(self.norm(x[:, top : top + height, left : left + width]))
        return outputs

    def _strangers(self, x: torch.Tensor) -> torch.Tensor:
        """What shifted layers add to their logits, (windows, T, T)."""
        foreign = windows.strangers(x.shape[1:3], self.window, x.device)
        return torch.zeros(foreign.shape, dtype=x.dtype, device=x.device).masked_fill_(foreign, -math.inf)


INFERENCE_WINDOW = 6
INFERENCE_LAYERS = 5


class Inference(MessageStack):
    """Candidate disparities weigh each other against the images and against their neighbours."""

    def __init__(self, width: int, candidates: int) -> None:
        super().__init__(width, INFERENCE_WINDOW, INFERENCE_LAYERS, candidates)

    def forward(self, labels: torch.Tensor, features: MatchingFeatures) -> list[torch.Tensor]:
        """Labels (B, h, w, N) in units of 1/8 px -> tokens (B, h, w, N, c), one a layer in training."""
        code = disparity_code(labels, EIGHTH_UNIT)
        return self.pass_messages(features.unary(labels), code)


REFINEMENT_WINDOW = 4
REFINEMENT_LAYERS = 5


class Refinement(MessageStack):
    """The chosen disparity of each pixel is compared with its neighbours' at twice the resolution."""

    def __init__(self, width: int) -> None:
        super().__init__(width, REFINEMENT_WINDOW, REFINEMENT_LAYERS, candidates=1)

    def forward(self, disparity: torch.Tensor, features: MatchingFeatures) -> list[torch.Tensor]:
        """Disparity (B, h, w) in units of 1/4 px -> tokens (B, h, w, c), one a layer in training."""
        candidates = disparity[..., None]
        code = disparity_code(candidates, QUARTER_UNIT)
        tokens = self.pass_messages(features.unary(candidates), code)
        return [layer.squeeze(-2) for layer in tokens]
