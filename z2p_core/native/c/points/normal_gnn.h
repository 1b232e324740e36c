/* What the network of refine.c holds, of as many ROUNDS and as WIDTH as refine_weights.h says. */

#pragma once

#define FEATURES 6 /* numbers that are read of a neighbour */

typedef struct {
    float pair[FEATURES][WIDTH], bias[WIDTH], own[WIDTH][WIDTH], other[WIDTH][WIDTH]; /* what the units read */
    float vote[4][WIDTH];                                 /* for the normal, either climb, and the height */
    float keep[WIDTH][WIDTH], learn[WIDTH][WIDTH], forget[WIDTH]; /* what is remembered; unused in the last round */
} Round;

typedef struct {
    float start[3][WIDTH]; /* times 1, the noise and its square */
    Round rounds[ROUNDS];
} Network;
