/* Random checks with `lanes_check.h`. Each answer is printed as bits, for one set of instructions. */

#include <stdio.h>
#include <stdlib.h>

#include "lanes_check.h"

enum { PARTS = 10, JOINTS = 7, NODES = 31, ROUNDS = 400 };

static uint64_t state = 88172645463325252u;

static double number(double low, double high) {
    state ^= state << 13, state ^= state >> 7, state ^= state << 17;
    return low + (high - low) * (double)(state >> 11) / 9007199254740992.0;
}

/* A node at a random place near another one, and the nodes below it. One number for each statement: the order in
which arguments are evaluated depends on the compiler. */
static int grow(LaneNode *nodes, int index, int depth, const LaneNode *near, double spread, double outer) {
    LaneNode *node = &nodes[index];
    int next = index + 1;
    node->x = near->x + (float)number(-spread, spread);
    node->y = near->y + (float)number(-spread, spread);
    node->z = near->z + (float)number(-spread, spread);
    node->outer = (float)outer;
    node->inner = (float)(outer * number(-0.5, 0.6));
    node->depth = depth;
    if (depth < 4)
        for (int child = 0; child < 2; child++)
            next = grow(nodes, next, depth + 1, node, 0.4 * outer, 0.75 * outer);
    node->skip = next;
    return next;
}

static void turned(float *turn) {
    double w = number(-1, 1);
    double x = number(-1, 1);
    double y = number(-1, 1);
    double z = number(-1, 1);
    double n = w * w + x * x + y * y + z * z;
    double out[9] = {1 - 2 * (y * y + z * z) / n, 2 * (x * y - w * z) / n, 2 * (x * z + w * y) / n,
                     2 * (x * y + w * z) / n, 1 - 2 * (x * x + z * z) / n, 2 * (y * z - w * x) / n,
                     2 * (x * z - w * y) / n, 2 * (y * z + w * x) / n, 1 - 2 * (x * x + y * y) / n};
    for (int i = 0; i < 9; i++) turn[i] = (float)out[i];
}

int main(int argc, char **argv) {
    static LaneNode nodes[PARTS][NODES];
    static LanePart parts[PARTS];
    static LaneLink links[JOINTS];
    static LanePair pairs[PARTS * PARTS];
    static float least[PARTS * PARTS], rates[JOINTS * LANES], half[LANES], bend[PARTS * LANES_JOINTS];
    static float places[4 * LANES * PARTS];
    static double joints[JOINTS * LANES];
    static int order[PARTS * PARTS], failing[PARTS * PARTS];
    static unsigned lanes[2 * PARTS * PARTS];
    const LaneNode origin = {0};
    LaneCheck check = lanes_with(argc > 1 ? argv[1] : "");
    if (!check) return 77;
    for (int round = 0; round < ROUNDS; round++) {
        int count = 0;
        for (int i = 0; i < JOINTS; i++) {
            links[i] = (LaneLink){i - 1, i == 2, number(-1, 1), {0}, {0}};
            turned(links[i].turn);
            for (int k = 0; k < 3; k++) links[i].offset[k] = (float)number(-0.3, 0.3);
        }
        for (int i = 0; i < PARTS; i++) {
            LanePart *part = &parts[i];
            part->joint = i < 5 ? i + 1 : -1;
            part->kind = i < 5 ? LANES_TREE : i - 5 + LANES_CLOUD;
            part->count = i < 6 ? grow(nodes[i], 0, 0, &origin, 0.2, number(0.05, 0.2)) : 0;
            part->nodes = nodes[i];
            turned(part->turn);
            for (int k = 0; k < 3; k++) {
                part->origin[k] = (float)number(-1, 1);
                part->size[k] = (float)number(0.02, 0.3);
            }
            part->round = (float)number(0, 0.1);
            part->slack = 1e-6f;
        }
        for (int i = 0; i < 5; i++)
            for (int k = i + 2; k < PARTS; k++) {
                pairs[count] = k < 5 ? (LanePair){k, i, i + 1, i + 2, -1} : (LanePair){i, k, -1, 0, -1};
                least[count] = (float)number(-0.01, 0.02);
                order[count] = count;
                count++;
            }
        for (int i = 0; i < JOINTS * LANES; i++) {
            joints[i] = number(-7, 7);
            rates[i] = (float)number(-1, 1);
        }
        for (int i = 0; i < LANES; i++) half[i] = (float)number(0, 0.2);
        for (int i = 0; i < PARTS * LANES_JOINTS; i++) bend[i] = (float)number(0, 3);
        LaneModel model = {JOINTS, links, parts, PARTS, pairs, least, 1e-5f};
        LaneQuery query = {joints, rates, half, bend, order, count, 0xffff, round % 3};
        LaneAnswer answer = {0, 0, 0, 0, 0, failing, lanes, places};
        check(&model, &query, &answer);
        printf("%x %x %x %d %d", answer.hit, answer.open, answer.unsure, answer.hit_pair, answer.failing_count);
        for (int i = 0; i < answer.failing_count; i++) printf(" %d:%x:%x", failing[i], lanes[2 * i], lanes[2 * i + 1]);
        for (int i = 0; i < 4 * LANES * 6; i++) {
            uint32_t bits;
            memcpy(&bits, &places[i], sizeof bits);
            printf(" %x", bits);
        }
        printf("\n");
    }
    return 0;
}
