/* Collision checks of sixteen configurations at once, with trees of spheres around each part of the arm.

The file includes itself, once for each set of instructions, with the same arithmetic: all give the same bits.
Lane i of each vector belongs to configuration i. See `clearance.pyx` and docs/planning-theory.md.

An outer sphere encloses a piece of a part, and the inner sphere with the same centre lies within the part. So
one distance of the centre from an obstacle gives one of three answers for a lane:

    distance >= outer radius + required distance + motion   proven: the piece is free in the whole interval
    distance <  inner radius + required distance            hit: the part is too near, whatever its exact shape
    otherwise                                               open: look at the pieces of the piece

"Motion" bounds how far the part moves within the interval of the edge around the configuration: half the
interval times the current velocity, plus half its square times the largest second derivative. Radii, distances
and motions contain a bound for the rounding of float32 (`slack`).
*/

#ifndef LANES_BODY
#ifndef COBOT_LANES_CHECK_H
#define COBOT_LANES_CHECK_H

#include <string.h>

#include "lanes.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#if !defined(__clang__) && defined(__OPTIMIZE__)
#pragma GCC push_options
#pragma GCC optimize ("O3")
#endif
#define LANES_BODY
#define LANES_NAME(x) x##_plain
#include "lanes_check.h"
#undef LANES_NAME

#if defined(__x86_64__)
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx2")
#endif
#define LANES_AVX2
#define LANES_NAME(x) x##_avx2
#include "lanes_check.h"
#undef LANES_NAME
#undef LANES_AVX2
#if defined(__clang__)
#pragma clang attribute pop
#pragma clang attribute push(__attribute__((target("avx2,avx512f,avx512dq,avx512vl,avx512bw"))), apply_to = function)
#else
#pragma GCC pop_options
#pragma GCC push_options
#pragma GCC target("avx2,avx512f,avx512dq,avx512vl,avx512bw,prefer-vector-width=512")
#endif
#define LANES_AVX512
#define LANES_NAME(x) x##_avx512
#include "lanes_check.h"
#undef LANES_NAME
#undef LANES_AVX512
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif
#endif
#undef LANES_BODY
#if !defined(__clang__) && defined(__OPTIMIZE__)
#pragma GCC pop_options
#endif

/* The check with the named instructions, "" for the best ones; NULL if this processor lacks them. */
static LaneCheck lanes_with(const char *name) {
#if defined(__x86_64__)
    __builtin_cpu_init();
    int wide = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")
               && __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
    if (wide && (!*name || !strcmp(name, "avx512"))) return check_avx512;
    if (__builtin_cpu_supports("avx2") && (!*name || !strcmp(name, "avx2"))) return check_avx2;
#endif
    return !*name || !strcmp(name, "plain") ? check_plain : NULL;
}

#endif
#else /* LANES_BODY */

#define vf LANES_NAME(vf)
#define vi LANES_NAME(vi)
#define vd LANES_NAME(vd)
#define State LANES_NAME(LaneState)
#define Walk LANES_NAME(LaneWalk)
typedef float vf __attribute__((vector_size(4 * LANES)));
typedef int32_t vi __attribute__((vector_size(4 * LANES)));
typedef double vd __attribute__((vector_size(8 * LANES)));

typedef struct {
    vf turn[LANES_JOINTS][9], place[LANES_JOINTS][3];
    vf spin[LANES_JOINTS][3], speed[LANES_JOINTS][3]; /* per unit of the edge; the speed of the joint's place */
    vf half, bow;                                     /* half an interval, and half its square */
} State;

typedef struct {
    vf need;              /* required distance with motion and slack */
    float still, touch;   /* without motion; and below which a hit is certain */
    unsigned open, unsure;
    unsigned decided;     /* lanes that are not looked at further: unsure ones, unless a hit may follow */
} Walk;

/* One bit for each lane in which a comparison is true. */
static inline unsigned LANES_NAME(bits)(const vi *which) {
#if defined(LANES_AVX512)
    return _mm512_movepi32_mask((__m512i)*which);
#elif defined(LANES_AVX2)
    __m256i part[2];
    memcpy(part, which, sizeof part);
    return (unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(part[0]))
           | (unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(part[1])) << 8;
#elif defined(__x86_64__)
    __m128 part[4];
    memcpy(part, which, sizeof part);
    return (unsigned)_mm_movemask_ps(part[0]) | (unsigned)_mm_movemask_ps(part[1]) << 4
           | (unsigned)_mm_movemask_ps(part[2]) << 8 | (unsigned)_mm_movemask_ps(part[3]) << 12;
#else
    unsigned out = 0;
    for (int lane = 0; lane < LANES; lane++) out |= (unsigned)((*which)[lane] & 1) << lane;
    return out;
#endif
}

static inline __attribute__((always_inline)) void LANES_NAME(beyond)(vf *value, float limit) {
    vf over = (vf)((vi)*value & 0x7fffffff) - limit; /* max(|value| - limit, 0) */
    *value = (vf)((vi)over & ~((vi)over >> 31));
}

/* Never less than the square root, by at most 1e-6 of it: two steps of Newton, which come from above. */
static inline __attribute__((always_inline)) void LANES_NAME(root)(vf *square) {
    vf value = *square + 1e-20f;
    vf guess = (vf)(((vi)value >> 1) + 0x1fbd1df5);
    guess = 0.5f * (guess + value / guess);
    guess = 0.5f * (guess + value / guess);
    *square = guess * 1.000001f;
}

/* Sine and cosine, within 1e-6, by the series of half the angle. */
static inline __attribute__((always_inline)) void LANES_NAME(circle)(const double *angles, double rest, vf *sine, vf *cosine) {
    vd angle;
    memcpy(&angle, angles, sizeof angle);
    angle -= rest;
    vd turns = angle * 0.15915494309189535 + 6755399441055744.0;
    turns -= 6755399441055744.0;
    angle -= turns * 6.283185307179586;
    vf y = 0.5f * __builtin_convertvector(angle, vf);
    vf x = y * y;
    vf s = y * (1.0f + x * (-1.6666667e-1f + x * (8.3333333e-3f + x * (-1.9841270e-4f + x * (2.7557319e-6f - x * 2.5052108e-8f)))));
    vf c = 1.0f + x * (-0.5f + x * (4.1666667e-2f + x * (-1.3888889e-3f + x * (2.4801587e-5f + x * (-2.7557319e-7f + x * 2.0876757e-9f)))));
    *sine = 2.0f * s * c;
    *cosine = 1.0f - 2.0f * s * s;
}

static void LANES_NAME(move)(const LaneModel *model, const LaneQuery *query, State *state) {
    const vf none = {0.0f};
    memcpy(&state->half, query->half, sizeof state->half);
    state->bow = 0.5f * state->half * state->half;
    for (int joint = 0; joint < model->dof; joint++) {
        const LaneLink *link = &model->links[joint];
        vf *turn = state->turn[joint], *place = state->place[joint];
        vf *spin = state->spin[joint], *speed = state->speed[joint];
        vf rate;
        memcpy(&rate, query->rates + LANES * joint, sizeof rate);
        if (link->before < 0) {
            for (int i = 0; i < 9; i++) turn[i] = none + link->turn[i];
            for (int i = 0; i < 3; i++) place[i] = none + link->offset[i], spin[i] = none, speed[i] = none;
        } else {
            const vf *base = state->turn[link->before], *start = state->place[link->before];
            const vf *turns = state->spin[link->before];
            vf way[3];
            for (int i = 0; i < 3; i++) {
                way[i] = base[3 * i] * link->offset[0] + base[3 * i + 1] * link->offset[1] + base[3 * i + 2] * link->offset[2];
                place[i] = start[i] + way[i];
                spin[i] = turns[i];
                for (int k = 0; k < 3; k++)
                    turn[3 * i + k] = base[3 * i] * link->turn[k] + base[3 * i + 1] * link->turn[3 + k]
                                      + base[3 * i + 2] * link->turn[6 + k];
            }
            for (int i = 0; i < 3; i++) {
                int k = (i + 1) % 3, n = (i + 2) % 3;
                speed[i] = state->speed[link->before][i] + (turns[k] * way[n] - turns[n] * way[k]);
            }
        }
        if (link->slides) {
            vd angle;
            memcpy(&angle, query->joints + LANES * joint, sizeof angle);
            vf moved = __builtin_convertvector(angle - link->rest, vf);
            for (int i = 0; i < 3; i++) {
                int k = (i + 1) % 3, n = (i + 2) % 3;
                place[i] += moved * turn[3 * i + 2];
                speed[i] += rate * turn[3 * i + 2] + moved * (spin[k] * turn[3 * n + 2] - spin[n] * turn[3 * k + 2]);
            }
            continue;
        }
        vf s, c;
        LANES_NAME(circle)(query->joints + LANES * joint, link->rest, &s, &c);
        for (int i = 0; i < 3; i++) {
            vf across = turn[3 * i], up = turn[3 * i + 1];
            turn[3 * i] = c * across + s * up;
            turn[3 * i + 1] = c * up - s * across;
            spin[i] += rate * turn[3 * i + 2];
        }
    }
}

static inline __attribute__((always_inline)) void LANES_NAME(centre)(const State *state, const LanePart *part, const LaneNode *node, vf *out) {
    if (part->joint < 0) {
        const vf none = {0.0f};
        out[0] = none + node->x, out[1] = none + node->y, out[2] = none + node->z;
        return;
    }
    const vf *turn = state->turn[part->joint], *place = state->place[part->joint];
    for (int i = 0; i < 3; i++)
        out[i] = place[i] + (turn[3 * i] * node->x + turn[3 * i + 1] * node->y + turn[3 * i + 2] * node->z);
}

/* How far a part can move within the intervals, seen from the joint that moves the other part too. */
static inline void LANES_NAME(motion)(const State *state, const LanePart *part, int common, float bend, vf *out) {
    const vf none = {0.0f};
    if (part->joint < 0 || part->joint == common) {
        *out = none;
        return;
    }
    const vf *place = state->place[part->joint];
    vf at[3], spin[3], speed[3];
    LANES_NAME(centre)(state, part, part->nodes, at);
    for (int i = 0; i < 3; i++) spin[i] = state->spin[part->joint][i], speed[i] = state->speed[part->joint][i];
    for (int i = 0; i < 3; i++) {
        int k = (i + 1) % 3, n = (i + 2) % 3;
        speed[i] += state->spin[part->joint][k] * (at[n] - place[n]) - state->spin[part->joint][n] * (at[k] - place[k]);
    }
    if (common >= 0) {
        const vf *from = state->place[common], *turns = state->spin[common];
        for (int i = 0; i < 3; i++) {
            int k = (i + 1) % 3, n = (i + 2) % 3;
            speed[i] -= state->speed[common][i] + (turns[k] * (at[n] - from[n]) - turns[n] * (at[k] - from[k]));
            spin[i] -= turns[i];
        }
    }
    vf fast = speed[0] * speed[0] + speed[1] * speed[1] + speed[2] * speed[2];
    vf turned = spin[0] * spin[0] + spin[1] * spin[1] + spin[2] * spin[2];
    LANES_NAME(root)(&fast);
    LANES_NAME(root)(&turned);
    *out = 1.0001f * (state->half * (fast + turned * part->nodes->outer) + state->bow * bend);
}

/* The squared distance of points from a standing shape without its `round`; from a plane the distance. */
static inline __attribute__((always_inline)) void LANES_NAME(away)(const LanePart *shape, const vf *at, vf *out) {
    vf x = at[0] - shape->origin[0], y = at[1] - shape->origin[1], z = at[2] - shape->origin[2];
    const float *turn = shape->turn;
    vf c = x * turn[2] + y * turn[5] + z * turn[8];
    if (shape->kind == LANES_PLANE) {
        *out = c;
        return;
    }
    vf a = x * turn[0] + y * turn[3] + z * turn[6];
    vf b = x * turn[1] + y * turn[4] + z * turn[7];
    LANES_NAME(beyond)(&c, shape->size[2]);
    if (shape->kind == LANES_BOX) {
        LANES_NAME(beyond)(&a, shape->size[0]);
        LANES_NAME(beyond)(&b, shape->size[1]);
    } else if (shape->kind == LANES_CYLINDER) {
        a = a * a + b * b;
        LANES_NAME(root)(&a);
        LANES_NAME(beyond)(&a, shape->size[0]);
        *out = a * a + c * c;
        return;
    }
    *out = a * a + b * b + c * c;
}

static inline __attribute__((always_inline)) void LANES_NAME(judge)(
    const vf *away, int linear, float outer, float inner, const Walk *walk, unsigned active, unsigned *left, unsigned *hit
) {
    const vf none = {0.0f};
    vf bound = walk->need + outer;
    vf small = none + 1e-6f;
    vi low = bound < small; /* a squared distance is never below zero, so the bound must be above it */
    bound = (vf)(((vi)bound & ~low) | ((vi)small & low));
    float touch = inner + walk->touch;
    vi passes = *away >= (linear ? bound : bound * bound);
    *left = active & ~LANES_NAME(bits)(&passes);
    *hit = 0;
    if (*left && touch > 0.0f) {
        vi meets = *away < (linear ? touch : touch * touch);
        *hit = *left & LANES_NAME(bits)(&meets);
    }
}

static inline void LANES_NAME(leaf)(const vf *away, int linear, float outer, Walk *walk, unsigned left) {
    const vf none = {0.0f};
    float bound = outer + walk->still;
    bound = bound < 1e-6f ? 1e-6f : bound;
    vi rests = *away < none + (linear ? bound : bound * bound);
    walk->open |= left;
    walk->unsure |= left & LANES_NAME(bits)(&rests);
}

/* The lanes that a piece cannot change. A lane that is open stays so: only what is too near without motion
   matters to it, and once it is unsure, only a hit. */
static inline __attribute__((always_inline)) unsigned LANES_NAME(settled)(
    const vf *away, int linear, float outer, const Walk *walk, unsigned left
) {
    const vf none = {0.0f};
    unsigned found = 0;
    if (left & walk->open) {
        float bound = outer + walk->still;
        bound = bound < 1e-6f ? 1e-6f : bound;
        vi far = *away >= none + (linear ? bound : bound * bound);
        found = walk->open & LANES_NAME(bits)(&far);
    }
    if (left & ~found & walk->unsure) {
        float bound = outer + walk->touch;
        vi far = *away >= none + bound * bound;
        found |= walk->unsure & LANES_NAME(bits)(&far);
    }
    return found;
}

/* A moving tree against a standing shape. Returns the lanes of a hit. */
static unsigned LANES_NAME(against_shape)(const State *state, const LanePart *part, const LanePart *shape, Walk *walk, unsigned active) {
    unsigned lanes[LANES_DEPTH + 1];
    int linear = shape->kind == LANES_PLANE, index = 0;
    lanes[0] = active;
    while (index < part->count) {
        const LaneNode *node = &part->nodes[index];
        unsigned left = lanes[node->depth] & ~walk->unsure, hit;
        if (left) {
            vf at[3], away;
            LANES_NAME(centre)(state, part, node, at);
            LANES_NAME(away)(shape, at, &away);
            LANES_NAME(judge)(&away, linear, node->outer + shape->round, node->inner + shape->round, walk, left, &left, &hit);
            if (hit) return hit;
            if (left) left &= ~LANES_NAME(settled)(&away, linear, node->outer + shape->round, walk, left);
            if (left && node->skip == index + 1) LANES_NAME(leaf)(&away, linear, node->outer + shape->round, walk, left);
        }
        lanes[node->depth + 1] = left;
        index = left ? index + 1 : node->skip;
    }
    return 0;
}

/* Two trees: of the two nodes, whose centres are given, the larger one is opened. */
static unsigned LANES_NAME(between_trees)(
    const State *state, const LanePart *first, int one, const vf *centre, const LanePart *second, int other,
    const vf *mate_centre, Walk *walk, unsigned active
) {
    const LaneNode *node = &first->nodes[one], *mate = &second->nodes[other];
    unsigned left = active & ~walk->decided, hit;
    if (!left) return 0;
    vf at[3], away;
    for (int i = 0; i < 3; i++) at[i] = centre[i] - mate_centre[i];
    away = at[0] * at[0] + at[1] * at[1] + at[2] * at[2];
    LANES_NAME(judge)(&away, 0, node->outer + mate->outer, node->inner + mate->inner, walk, left, &left, &hit);
    if (hit || !left) return hit;
    if (!(left &= ~LANES_NAME(settled)(&away, 0, node->outer + mate->outer, walk, left))) return 0;
    int splits = node->skip > one + 1, mate_splits = mate->skip > other + 1;
    if (!splits && !mate_splits) {
        LANES_NAME(leaf)(&away, 0, node->outer + mate->outer, walk, left);
        if (second->kind != LANES_CLOUD || walk->touch < -1e8f) walk->decided = walk->unsure;
        return 0;
    }
    if (splits && (!mate_splits || node->outer >= mate->outer)) {
        for (int below = one + 1; below < node->skip; below = first->nodes[below].skip) {
            LANES_NAME(centre)(state, first, &first->nodes[below], at);
            if ((hit = LANES_NAME(between_trees)(state, first, below, at, second, other, mate_centre, walk, left))) return hit;
        }
    } else {
        for (int below = other + 1; below < mate->skip; below = second->nodes[below].skip) {
            LANES_NAME(centre)(state, second, &second->nodes[below], at);
            if ((hit = LANES_NAME(between_trees)(state, first, one, centre, second, below, at, walk, left))) return hit;
        }
    }
    return 0;
}

/* The same for the whole trees of two parts. */
static unsigned LANES_NAME(between_parts)(
    const State *state, const LanePart *first, const LanePart *second, Walk *walk, unsigned active
) {
    vf centre[3], mate_centre[3];
    LANES_NAME(centre)(state, first, first->nodes, centre);
    LANES_NAME(centre)(state, second, second->nodes, mate_centre);
    return LANES_NAME(between_trees)(state, first, 0, centre, second, 0, mate_centre, walk, active);
}

static void LANES_NAME(check)(const LaneModel *model, const LaneQuery *query, LaneAnswer *answer) {
    State state;
    vf motions[64];
    unsigned known[2] = {0, 0};
    answer->hit = answer->open = answer->unsure = 0;
    answer->hit_pair = -1;
    answer->failing_count = 0;
    LANES_NAME(move)(model, query, &state);
    if (answer->places)
        for (int index = 0; index < model->part_count; index++) {
            const LanePart *part = &model->parts[index];
            vf out[4];
            if (!part->count) continue;
            LANES_NAME(centre)(&state, part, part->nodes, out);
            LANES_NAME(motion)(&state, part, -1, query->bend[LANES_JOINTS * index], &out[3]);
            memcpy(answer->places + 4 * LANES * index, out, sizeof out);
        }
    for (int index = 0; index < query->pair_count; index++) {
        const LanePair *pair = &model->pairs[query->pairs[index]];
        const LanePart *first = &model->parts[pair->first], *second = &model->parts[pair->second];
        Walk walk;
        float least = model->least[query->pairs[index]], slack = model->slack + second->slack;
        unsigned hit, active = query->active & ~answer->hit;
        int keep = pair->common < 0 && pair->first < 64;
        if (keep && known[pair->first / 32] >> pair->first % 32 & 1) walk.need = motions[pair->first];
        else {
            LANES_NAME(motion)(&state, first, pair->common,
                pair->first_joint < 0 ? 0.0f : query->bend[LANES_JOINTS * pair->first + pair->first_joint], &walk.need);
            if (keep) motions[pair->first] = walk.need, known[pair->first / 32] |= 1u << pair->first % 32;
        }
        if (second->joint >= 0 && pair->second_joint >= 0) {
            vf more;
            LANES_NAME(motion)(&state, second, pair->common, query->bend[LANES_JOINTS * pair->second + pair->second_joint], &more);
            walk.need += more;
        }
        walk.still = (least > 0.0f ? least : 0.0f) + slack; /* pieces apart do not limit how deep their bodies overlap */
        walk.touch = query->all == LANES_NEAR ? -1e9f : least - slack;
        walk.need += walk.still;
        walk.open = walk.unsure = walk.decided = 0;
        hit = second->kind <= LANES_CLOUD
            ? LANES_NAME(between_parts)(&state, first, second, &walk, active)
            : LANES_NAME(against_shape)(&state, first, second, &walk, active);
        if (hit) {
            answer->hit |= hit;
            answer->hit_pair = query->pairs[index];
            if (!query->all) return;
            index -= 1; /* the same pair again, without the lanes that are decided */
            continue;
        }
        if (walk.open) {
            answer->open |= walk.open;
            answer->unsure |= walk.unsure;
            answer->lanes[2 * answer->failing_count] = walk.open;
            answer->lanes[2 * answer->failing_count + 1] = walk.unsure;
            answer->failing[answer->failing_count++] = query->pairs[index];
        }
    }
}

#undef vf
#undef vi
#undef vd
#undef State
#undef Walk
#endif
