/* Clip planes per disc; see disc_clipping.c. */

#pragma once

#define MAX_CLIP_PLANES 4 /* per disc, nearest to its center first; a plane is four floats: unit normal and offset */
