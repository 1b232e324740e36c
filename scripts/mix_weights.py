"""Averages two sets of weights of one network, one fine-tuned from the other: often better than either.

    python scripts/mix_weights.py BEFORE AFTER OUT [--share 0.7]

Each parameter is (1 - share) * BEFORE + share * AFTER (Wortsman et al., Model soups, 2022). This keeps what
fine-tuning on new shapes has improved, and loses less on the shapes before.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from z2p_renderer.storage.models.checkpoints import WeightsError, find_weights, load_weights, save_weights


def main() -> None:
    """Writes the mixed weights, with AFTER's card."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", help="shipped name or file")
    parser.add_argument("after", help="likewise, of the same network")
    parser.add_argument("out", type=Path)
    parser.add_argument("--share", type=float, default=0.7, help="what AFTER counts, from 0 to 1")
    options = parser.parse_args()
    try:
        mix(options.before, options.after, options.out, options.share)
    except (WeightsError, ValueError) as error:
        sys.exit(f"Error: {error}")


def mix(before: str, after: str, out: Path, share: float) -> None:
    """Writes to `out` the weighted mean of both, with weight `share` for `after`.

    Raises:
        WeightsError: a set cannot be read.
        ValueError: a share outside of 0 to 1, or weights of another network, other channels or other controls.
    """
    if not 0 <= share <= 1:
        raise ValueError(f"expected a share from 0 to 1, got {share:g}")
    old, new = (load_weights(find_weights(one)) for one in (before, after))
    for part in ("network", "gbuffer", "zbuffer", "encoder", "controls"):
        if old.card.get(part) != new.card.get(part):
            raise ValueError(
                f"expected weights of the same {part}, got {old.card.get(part)} in {before} and "
                f"{new.card.get(part)} in {after}; only a network that began as the other can be mixed"
            )
    tensors = {name: (1 - share) * old.tensors[name] + share * tensor for name, tensor in new.tensors.items()}
    save_weights(out, tensors, new.card)


if __name__ == "__main__":
    main()
