from z2p_coat import Coat

from z2p_core.scene import SceneDescription
from z2p_core.testing import check_control


def test_contract() -> None:
    check_control(Coat)


def test_coat_reaches_the_scene() -> None:
    scene = SceneDescription()
    Coat().apply((0.8,), scene)
    assert scene.material["Coat Weight"] == 0.8
