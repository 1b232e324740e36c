/* What a disc ends at. */

#define CLIPS 4 /* planes at most, by the nearest end first, each four numbers: a unit normal and how far along it */
