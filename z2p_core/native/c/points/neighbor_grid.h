/* Nearest neighbors in a point cloud: a uniform grid, or a k-d tree where most points crowd in few of its cells. */

#pragma once

#define MAX_NEIGHBORS 64

/* Node of the k-d tree: its points are split at `position` along `axis`. */
typedef struct {
    float position;
    int axis;
} Split;

typedef struct {
    float low[3], cell_size; /* least coordinates of the points; edge length of the cells */
    int size[3];             /* cells along each axis */
    int *start;              /* first point of each cell, and one past the last point */
    float *x, *y, *z;        /* coordinates of the sorted points; y and z lie in the same block as x */
    int count, levels;       /* number of points, and levels of the tree */
    Split *splits;           /* nodes of the tree, level by level; NULL if the grid is used */
} Grid;

typedef struct {
    int max_count, count, indices[MAX_NEIGHBORS];
    float distance_sq[MAX_NEIGHBORS]; /* ascending */
} Nearest;

/* Finds nearest->max_count points near `points[query]`, nearest first; itself among them if it is one of the grid's.
 * All but the farthest few are exact. At least one is found. */
void find_nearest(const Grid *grid, const float *points, int query, Nearest *nearest);
