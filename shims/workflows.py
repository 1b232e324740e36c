"""What ``luigi --module workflows FullPipeline`` imports where z2p is installed; z2p itself never imports this name."""

from z2p_renderer.workflows import Ablations as Ablations
from z2p_renderer.workflows import FullPipeline as FullPipeline
from z2p_renderer.workflows import PaperReport as PaperReport
