"""Values of several controls: the settings vector that the network reads, and the scene that they describe.

Training and inference both use these two functions, so that the network always sees the order that it was trained with.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from z2p_core.interfaces import Control, Value
from z2p_core.scene import SceneDescription


def settings_vector(values: Mapping[str, Value], controls: Mapping[str, Control]) -> np.ndarray:
    """The settings vector s (S,) float32 (paper section 3.3): each control's encoding, in the order of `controls`.

    `values` holds one value for each control, by its name, in any order. S is the sum of the controls' sizes.

    Raises:
        KeyError: a control has no value.
    """
    encoded = [number for name, control in controls.items() for number in control.encode(tuple(values[name]))]
    return np.array(encoded, dtype=np.float32)


def apply_controls(values: Mapping[str, Value], controls: Mapping[str, Control], scene: SceneDescription) -> None:
    """Write each control's value into the scene, in the order of `controls`: a later one may change the same input.

    Raises:
        KeyError: a control has no value.
    """
    for name, control in controls.items():
        control.apply(values[name], scene)
