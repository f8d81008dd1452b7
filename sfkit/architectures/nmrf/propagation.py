"""Label propagation: five layers of messages along rows and columns refine the seeds' embeddings."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.nmrf.layers import EIGHTH_UNIT, LENGTH, FeedForward, disparity_code

LAYERS = 5
STRIPE_HEADS = 2
REACH = 4  # a seed's cost patch spans 4 bins on each side


class StripeAttention(nn.Module):
    """Attention between all candidates of one stripe: a single column, or a single row, of the grid.

    Candidates of one pixel do not see each other. A depthwise convolution adds a local term.
    """

    def __init__(self, width: int, vertical: bool) -> None:
        super().__init__()
        self.vertical = vertical
        # The stripe is one pixel wide, so only the kernel's middle column (or row) ever acts.
        self.get_v = nn.Conv2d(width, width, 3, padding=1, groups=width, bias=False)

    def forward(self, q: torch.Tensor, k: torch.Tensor, v: torch.Tensor, seen: torch.Tensor) -> torch.Tensor:
        """q, k, v (B, h, w, N, c) and ``seen`` (length * N, length * N) bool -> (B, h, w, N, c)."""
        queries, keys, values = (self._to_stripes(x) for x in (q, k, v))
        attended = F.scaled_dot_product_attention(queries, keys, values, attn_mask=seen)
        return self._from_stripes(attended, v.shape) + self._local(v)

    def _to_stripes(self, x: torch.Tensor) -> torch.Tensor:
        """(B, h, w, N, c) -> (B * stripes, heads, length * N, c / heads), position-major."""
        x = x.transpose(1, 2) if self.vertical else x
        batch, stripes, length, candidates, _ = x.shape
        return x.reshape(batch * stripes, length * candidates, STRIPE_HEADS, -1).transpose(1, 2)

    def _from_stripes(self, x: torch.Tensor, shape: torch.Size) -> torch.Tensor:
        batch, height, width, candidates, channels = shape
        stripes, length = (width, height) if self.vertical else (height, width)
        grid = x.transpose(1, 2).reshape(batch, stripes, length, candidates, channels)
        return grid.transpose(1, 2) if self.vertical else grid

    def _local(self, v: torch.Tensor) -> torch.Tensor:
        """Neighbours contribute the sum of their candidates, the centre tap the candidate's own value."""
        weight = self.get_v.weight
        kernel, padding = (weight[:, :, :, 1:2], (1, 0)) if self.vertical else (weight[:, :, 1:2, :], (0, 1))
        total = v.sum(-2)
        summed = F.conv2d(total.permute(0, 3, 1, 2), kernel, padding=padding, groups=weight.shape[0])
        # The centre tap has seen every candidate of its place: all but the own one are taken away again.
        others = total[..., None, :] - v
        return summed.permute(0, 2, 3, 1)[..., None, :] - weight[:, 0, 1, 1] * others


class StripeMessages(nn.Module):
    """One layer: half the channels talk along columns, half along rows; then a feed-forward block."""

    def __init__(self, width: int, context: int) -> None:
        super().__init__()
        self.q = nn.Linear(width + context, width)
        self.k = nn.Linear(width + context, width)
        self.v = nn.Linear(width, width)
        self.norm1 = nn.LayerNorm(width)
        self.proj = nn.Linear(width, width)
        self.attns = nn.ModuleList(StripeAttention(width // 2, vertical) for vertical in (True, False))
        self.mlp = FeedForward(width, 4 * width, width)
        self.norm2 = nn.LayerNorm(width)

    def forward(
        self, x: torch.Tensor, context: torch.Tensor, seen: tuple[torch.Tensor, torch.Tensor]
    ) -> torch.Tensor:
        """Tokens (B, h, w, N, c), context (B, h, w, N, k), masks for columns and rows -> tokens."""
        t = self.norm1(x)
        with_context = torch.cat((t, context.to(t.dtype)), -1)
        q, k, v = (y.chunk(2, -1) for y in (self.q(with_context), self.k(with_context), self.v(t)))
        messages = [attn(*each) for attn, *each in zip(self.attns, q, k, v, seen, strict=True)]
        x = x + self.proj(torch.cat(messages, -1))
        y: torch.Tensor = x + self.mlp(self.norm2(x))
        return y


class PropagationLayer(nn.Module):
    """A layer as the state dict names it."""

    def __init__(self, width: int, context: int) -> None:
        super().__init__()
        self.nmp = StripeMessages(width, context)

    def forward(
        self, x: torch.Tensor, context: torch.Tensor, seen: tuple[torch.Tensor, torch.Tensor]
    ) -> torch.Tensor:
        """As :class:`StripeMessages`."""
        y: torch.Tensor = self.nmp(x, context, seen)
        return y


class Propagation(nn.Module):
    """Seeds, their costs and the image's context -> one embedding a candidate."""

    def __init__(self, width: int, context: int, groups: int) -> None:
        super().__init__()
        patch = groups * (2 * REACH + 1)
        self.cost_encoder = nn.Sequential(nn.Linear(patch, width), nn.GELU(), nn.Linear(width, width))
        self.proj = nn.Linear(width + LENGTH, width, bias=False)
        self.layers = nn.ModuleList(PropagationLayer(width, context) for _ in range(LAYERS))
        self.norm = nn.LayerNorm(width)

    def forward(self, seeds: torch.Tensor, cost: torch.Tensor, context: torch.Tensor) -> torch.Tensor:
        """Embeddings of the candidates.

        Args:
            seeds: (B, h, w, N) integers in units of 1/8 px.
            cost: (B, h, w, G, D), the raw cost volume.
            context: (B, h, w, k).

        Returns:
            (B, h, w, N, c).
        """
        height, width, candidates = seeds.shape[1:]
        code = disparity_code(seeds.to(cost.dtype), EIGHTH_UNIT)
        patches = self.cost_encoder(cost_patches(cost, seeds))
        x = self.proj(torch.cat((patches, code.to(patches.dtype)), -1))
        context = context[..., None, :].expand(*seeds.shape, -1)
        seen = tuple(_other_pixels_or_self(length, candidates, x.device) for length in (height, width))
        for layer in self.layers:
            x = layer(x, context, seen)
        y: torch.Tensor = self.norm(x)
        return y


def cost_patches(cost: torch.Tensor, seeds: torch.Tensor) -> torch.Tensor:
    """The costs around each seed: (B, h, w, G, D), (B, h, w, N) -> (B, h, w, N, G * 9), group-major.

    Offsets -4 .. 4 in bins; a bin beyond the range repeats the last one.
    """
    offsets = torch.arange(-REACH, REACH + 1, device=cost.device)
    # At the volume's ends the outermost cost is repeated.
    index = (seeds[..., None] + offsets).clamp(0, cost.shape[-1] - 1)
    groups = cost.shape[-2]
    index = index[..., None, :].expand(*index.shape[:-1], groups, -1)
    table = cost[..., None, :, :].expand(*seeds.shape, groups, -1)
    return table.gather(-1, index).flatten(-2)


def _other_pixels_or_self(length: int, candidates: int, device: torch.device) -> torch.Tensor:
    """Whom a candidate listens to along a stripe: everyone but its own pixel's rivals, (T, T) bool."""
    place = torch.arange(length * candidates, device=device)  # no len(): exporters would keep it as a number
    pixel = place // candidates
    return (pixel[:, None] != pixel[None, :]) | (place[:, None] == place[None, :])
