/* Weights of the network in normal_gnn.c, of the ROUNDS and WIDTH that normal_gnn_weights.h defines. */

#pragma once

#define FEATURES 6 /* rotation-invariant features of a neighbor */

typedef struct {
    float pair[FEATURES][WIDTH], bias[WIDTH]; /* hidden layer: weights of the features */
    float own[WIDTH][WIDTH], other[WIDTH][WIDTH]; /* weights of the point's state, and of the neighbor's */
    float output[4][WIDTH]; /* coefficients of a neighbor's normal, offset (by its height over either normal), height */
    float keep[WIDTH][WIDTH], learn[WIDTH][WIDTH], forget[WIDTH]; /* state update: weights of the state and of
                                                                   * the aggregate, bias; unused in the last round */
} Round;

typedef struct {
    float start[3][WIDTH]; /* initial state: coefficients of 1, the noise and its square */
    Round rounds[ROUNDS];
} Network;
