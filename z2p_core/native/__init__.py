"""What the compiled kernels compute, as functions of numpy arrays. They hold no lock, so threads run side by side.

The C files lie in `c/`, by topic; installing the package compiles them. Arrays are float32 unless said otherwise, and
results are the same on every run, processor and number of threads.
"""

from z2p_core.native.images import GROUP as GROUP
from z2p_core.native.images import Convolution as Convolution
from z2p_core.native.images import intensity as intensity
from z2p_core.native.images import nearest_depth as nearest_depth
from z2p_core.native.images import packed as packed
from z2p_core.native.images import reconcile as reconcile
from z2p_core.native.images import reconcile_shadow as reconcile_shadow
from z2p_core.native.images import showing as showing
from z2p_core.native.images import straight_bytes as straight_bytes
from z2p_core.native.images import touched as touched
from z2p_core.native.images import window_minimum as window_minimum
from z2p_core.native.lighting import MOST_LIT as MOST_LIT
from z2p_core.native.lighting import Casters as Casters
from z2p_core.native.lighting import Floor as Floor
from z2p_core.native.lighting import direct_lighting as direct_lighting
from z2p_core.native.lighting import first_visible as first_visible
from z2p_core.native.lighting import floor_glow as floor_glow
from z2p_core.native.lighting import floor_hits as floor_hits
from z2p_core.native.lighting import floor_shade as floor_shade
from z2p_core.native.lighting import floor_shadow as floor_shadow
from z2p_core.native.lighting import gather_bounced as gather_bounced
from z2p_core.native.lighting import gather_open as gather_open
from z2p_core.native.lighting import gloss as gloss
from z2p_core.native.lighting import image as image
from z2p_core.native.lighting import in_other_cells as in_other_cells
from z2p_core.native.lighting import raycast_discs as raycast_discs
from z2p_core.native.list_rows import walk_rows as walk_rows
from z2p_core.native.points import Grid as Grid
from z2p_core.native.points import jets as jets
from z2p_core.native.points import planes as planes
from z2p_core.native.points import refine as refine
from z2p_core.native.points import slabs as slabs
from z2p_core.native.surfels import disc_clip_planes as disc_clip_planes
from z2p_core.native.surfels import find_hole_discs as find_hole_discs
from z2p_core.native.surfels import offset_disc_centers as offset_disc_centers
from z2p_core.native.surfels import rasterize_surfels as rasterize_surfels
from z2p_core.native.surfels import voronoi_extent as voronoi_extent
