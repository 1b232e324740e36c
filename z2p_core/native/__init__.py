"""What the compiled kernels compute, as functions of numpy arrays. They hold no lock, so threads run side by side.

The C files lie in `c/`, by topic; installing the package compiles them. Arrays are float32 unless said otherwise, and
results are the same on every run, processor and number of threads.
"""

from z2p_core.native.images import CHANNEL_GROUP as CHANNEL_GROUP
from z2p_core.native.images import Convolution as Convolution
from z2p_core.native.images import blend_shadow_towards as blend_shadow_towards
from z2p_core.native.images import blend_towards as blend_towards
from z2p_core.native.images import depth_to_intensity as depth_to_intensity
from z2p_core.native.images import extend_halved as extend_halved
from z2p_core.native.images import final_convs as final_convs
from z2p_core.native.images import multiply_linear as multiply_linear
from z2p_core.native.images import nearest_depth as nearest_depth
from z2p_core.native.images import pack_convolution as pack_convolution
from z2p_core.native.images import to_straight_rgba8 as to_straight_rgba8
from z2p_core.native.images import window_minimum as window_minimum
from z2p_core.native.lighting import MAX_LIT_POINTS as MAX_LIT_POINTS
from z2p_core.native.lighting import Floor as Floor
from z2p_core.native.lighting import ShadowCasters as ShadowCasters
from z2p_core.native.lighting import direct_lighting as direct_lighting
from z2p_core.native.lighting import fine_occlusion as fine_occlusion
from z2p_core.native.lighting import first_visible as first_visible
from z2p_core.native.lighting import floor_colors as floor_colors
from z2p_core.native.lighting import floor_irradiance as floor_irradiance
from z2p_core.native.lighting import floor_occlusion as floor_occlusion
from z2p_core.native.lighting import floor_shadow as floor_shadow
from z2p_core.native.lighting import floor_visibility as floor_visibility
from z2p_core.native.lighting import gather_colors as gather_colors
from z2p_core.native.lighting import gather_environment as gather_environment
from z2p_core.native.lighting import gather_indirect as gather_indirect
from z2p_core.native.lighting import gather_vectors as gather_vectors
from z2p_core.native.lighting import raycast_discs as raycast_discs
from z2p_core.native.lighting import resample_grid as resample_grid
from z2p_core.native.lighting import sharp_light_reflection as sharp_light_reflection
from z2p_core.native.lighting import specular_radiance as specular_radiance
from z2p_core.native.lighting import unshadowed_light as unshadowed_light
from z2p_core.native.list_rows import read_list_rows as read_list_rows
from z2p_core.native.points import MergedPoints as MergedPoints
from z2p_core.native.points import NeighborGrid as NeighborGrid
from z2p_core.native.points import fit_jets as fit_jets
from z2p_core.native.points import fit_planes as fit_planes
from z2p_core.native.points import fit_thin_slabs as fit_thin_slabs
from z2p_core.native.points import interpolate_values as interpolate_values
from z2p_core.native.points import merge_visible as merge_visible
from z2p_core.native.points import projected_coverage as projected_coverage
from z2p_core.native.points import refine_normals as refine_normals
from z2p_core.native.screen_grid import ScreenGrid as ScreenGrid
from z2p_core.native.surfels import TEXTURE_VALUES as TEXTURE_VALUES
from z2p_core.native.surfels import Blending as Blending
from z2p_core.native.surfels import Discs as Discs
from z2p_core.native.surfels import disc_clip_planes as disc_clip_planes
from z2p_core.native.surfels import find_hole_discs as find_hole_discs
from z2p_core.native.surfels import fit_disc_textures as fit_disc_textures
from z2p_core.native.surfels import offset_disc_centers as offset_disc_centers
from z2p_core.native.surfels import rasterize_surfels as rasterize_surfels
from z2p_core.native.surfels import voronoi_extent as voronoi_extent
