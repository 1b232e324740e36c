/* A grid of a bare cloud's points, for its points' neighbours; or a tree, where they crowd in few of its cells. */

#pragma once

#define MOST_NEIGHBOURS 64

/* Where a part of the tree's points is halved: at which place along which axis. */
typedef struct {
    float place;
    int axis;
} Split;

typedef struct {
    float low[3], cell;
    int size[3];
    int *start;        /* first point of each cell, and one past the last */
    float *x, *y, *z;  /* of the sorted points */
    int count, levels; /* points, and how often a tree halves them */
    Split *splits;     /* of the tree, a level after the other; NULL where there is none */
} Grid;

typedef struct {
    int most, count, found[MOST_NEIGHBOURS];
    float distance[MOST_NEIGHBOURS]; /* squared, nearest first */
} Near;

/* Sorts `points` (count, 3) by their cells, or parts of the tree, into `sorted`. Returns 0 when memory is short;
 * grid->start, grid->splits and grid->x, which the other axes lie behind, are to be freed. */
int build_grid(Grid *grid, const float *points, int count, float *sorted);

/* near->most near points of the place `points[self]`, nearest first, the nearest but for a few at the end: itself among
 * them, where it is one of the grid's. One at least is found. */
void find_nearest(const Grid *grid, const float *points, int self, Near *near);
