/* The data of `lanes_check.h`. */

#ifndef COBOT_LANES_H
#define COBOT_LANES_H

#include <stdint.h>

enum { LANES_NEAR = 2 };
enum { LANES = 16, LANES_JOINTS = 16, LANES_DEPTH = 32 };
enum { LANES_TREE, LANES_CLOUD, LANES_BOX, LANES_CYLINDER, LANES_SEGMENT, LANES_PLANE };

typedef struct {
    float x, y, z, outer, inner;
    int skip;                       /* the next node that is not below this one */
    int depth;
} LaneNode;

typedef struct {
    int before, slides;
    double rest;
    float turn[9], offset[3];
} LaneLink;

typedef struct {
    int joint;                      /* that moves it; -1: it stands */
    int kind;                       /* of a standing part: its shape, LANES_TREE for any other, LANES_CLOUD: a tree with more hits than its first leaves show */
    int count;                      /* of its nodes, in the joint's frame, or the world's if it stands */
    const LaneNode *nodes;
    float turn[9], origin[3], size[3], round; /* of a standing shape; `round` is added to it all around */
    float slack;
} LanePart;

typedef struct {
    int first, second;              /* the first one moves */
    int common;                     /* the last joint that moves both; -1: none */
    int first_joint, second_joint;  /* the first joints that move only one of them; -1: none */
} LanePair;

typedef struct {
    int dof;
    const LaneLink *links;
    const LanePart *parts;
    int part_count;
    const LanePair *pairs;
    const float *least;             /* required distance of each pair, m */
    float slack;
} LaneModel;

typedef struct {
    const double *joints;           /* joint by joint, LANES values each */
    const float *rates;             /* along the edge; joint by joint, LANES values each */
    const float *half;              /* half the interval of each lane, as a share of the edge */
    const float *bend;              /* part by part, for each joint: bound of its points' second derivatives */
    const int *pairs;
    int pair_count;
    unsigned active;                /* the lanes that count, a bit each */
    int all;                        /* go on after a hit; LANES_NEAR: look for none */
} LaneQuery;

typedef struct {
    unsigned hit, open, unsure;     /* unsure: open even without motion */
    int hit_pair;
    int failing_count;
    int *failing;                   /* pairs that are open in any lane */
    unsigned *lanes;                /* of each of them: the lanes that are open, and those that are unsure */
    float *places;                  /* unless NULL: centres and motions of the parts, 4 x LANES each */
} LaneAnswer;

typedef void (*LaneCheck)(const LaneModel *, const LaneQuery *, LaneAnswer *);

#endif
