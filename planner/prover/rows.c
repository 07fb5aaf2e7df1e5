/* Finds rows of separation for one step of a plan; planner.certificate.rows has the lemma.

   A task is a pair of clusters and a cell of time. It is separated by a direction, fixed in the
   frame that carries the second cluster, when the gap that the direction leaves at both ends of
   the cell, less the sag M h^2 / 8 + S h / 4 in between, is above the minimum gap of the pair.
   Otherwise a cluster or the cell is cut. Tasks are handled level by level, in the checker's order.

   Computed in doubles, without bounds on rounding: nothing of it is trusted, the checker decides.
   Each call has its own memory, so any number of threads may search. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define ROWS_VERSION 6

enum { BY_DIRECTION, BY_FINE_DIRECTION, BY_MIDDLES, CUT_FIRST, CUT_SECOND, CUT_TIME, NONE = 255 };
enum { PROVEN, TOO_NEAR, NOT_SHOWN, TOO_MUCH };

enum {
    MAX_JOINTS = 21,   /* of a chain: along one arm, back, and along the other */
    LANES = 8,          /* points of a cluster that are computed at once */
    TABLE = 1 << 14,    /* entries of a hash table, of which three quarters are used */
    MANY = 512,         /* nodes of so many points or more have lists of them by cells of directions */
    MAX_LISTED = 4096, /* points of such a node */
    HALVINGS = 3,       /* of each face of a cube of directions, in both ways */
    CELLS = 6 << (2 * HALVINGS),
    MAX_TASKS = 50000, /* of a level, as in the checker */
    STACK = 512,
    ITERATIONS = 30,
    CLIMBS = 40,
};

static const double FAR = 1e9;
static const double MIN_CELL_S = 2e-5;   /* cells of time are not cut below */
static const double MIN_TRAVEL = 0.02; /* the same as a share of a travel of fingers */
static const double APART_M = 3e-4;      /* farther apart in the middle of a cell: the cell is cut */
static const double LARGE_SAG = 4.0;     /* a sag so many times larger than the clusters: likewise */
static const double MIN_SAG_M = 1e-5;  /* below this sag, clusters are cut first */
static const double TOUCHING_SAG_M = 2e-3;
static const double CONVERGED = 1e-2;

typedef struct {             /* a tree of clusters in a frame of its own */
    const float *x, *y, *z;  /* points of all nodes, one after the other */
    int32_t *first;          /* of each node */
    const int32_t *count, *children;
    float *low, *high, *reach; /* its box, and the distance of its points from the origin */
    int32_t *lists;          /* of each node: where its lists begin in `begins`; -1 if it has none */
    int32_t *begins;         /* where the list of a cell of directions begins in `listed` */
    uint16_t *listed;        /* points that may be lowest along a direction of the cell */
} Tree;

typedef struct {             /* a tree in the frame of the joint that carries it */
    int32_t tree, has_apex;
    int32_t joined[2];       /* the trees whose roots are its children; -1: its nodes have their own */
    double R[9], p[3], ball, disc, apex[3];
} Placed;

typedef struct {
    int32_t first, second;   /* which of the placed trees */
    int32_t k, m;            /* the joints that carry them, k >= m; 0 for the base of the chain */
    int32_t is_counted;      /* whether it counts for the smallest distance */
    double least, begin, end;
    double slides[4];        /* of the first at the start and at the end, then of the second */
} Pair;

typedef struct {
    int32_t joints, pairs, pieces, orders, kinks;
    double duration, slack, spare;
    double margin, share;    /* counted pairs keep the margin, and a share of the smallest distance */
    const double *t;            /* of the knots */
    const double *derivatives;  /* `orders` of each piece, position first; the arm's position if no piece */
    const double *v_peak, *a_peak;
    const double *kinks_s, *jumps; /* times and sizes of the jumps of velocity */
    const double *spans_R, *spans_p, *offsets;
} Step;

typedef struct {
    int64_t tasks, directions, fine_directions;
    double nearest, nearest_s; /* the smallest distance found of counted pairs */
    double proven;             /* the smallest conclusion of all rows of counted pairs */
    double found, found_s;     /* of a refusal: the distance, and the time */
    int32_t nearest_pair, found_pair;
} Result;

typedef struct { int32_t tree, node; } Cluster;
typedef struct { int32_t pair, start, end, has_n; Cluster a, b; double n[3]; } Task;
typedef struct { double R[9], p[3]; } Frame; /* one frame seen from another */
typedef struct { double fixed, by_reach; } Sag; /* fixed + by_reach * reach */
typedef struct { int32_t start, end; } Cell;

typedef struct {             /* one call */
    const Tree *trees;
    const Placed *placed;
    const Pair *pairs;
    Step step;
    Result *result;
    int spans;               /* number of frames seen from others by some pair */
    int16_t span[MAX_JOINTS][MAX_JOINTS + 1]; /* the number of frame k seen from m < k; -1 for none */
    int8_t farthest[MAX_JOINTS], nearest[MAX_JOINTS + 1]; /* the last k for m, and the first m for k */
    double *times;           /* of instants */
    Frame *frames;           /* `spans` of each instant */
    Cell *cells;
    Sag *sags;               /* `spans` of each cell */
    int instant_count, instant_room, cell_count, cell_room;
    int32_t *instant_table, *cell_table, *measured_table;
} Search;

/* ---- vectors */

static inline double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static inline double norm(const double *a) { return sqrt(dot(a, a)); }
static inline void copy(const double *from, double *to) { memcpy(to, from, 3 * sizeof(double)); }

/* The nearest integer, without the library call that `rint` is without SSE4. */
static inline double rounded(double x) { return (double)(int)(x < 0 ? x - 0.5 : x + 0.5); }

static inline void turned(const double *R, const double *x, double *y) {
    for (int i = 0; i < 3; i++) y[i] = dot(R + 3 * i, x);
}

static inline void turned_back(const double *R, const double *x, double *y) {
    for (int i = 0; i < 3; i++) y[i] = R[i] * x[0] + R[3 + i] * x[1] + R[6 + i] * x[2];
}

static inline void product(const double *A, const double *B, double *C) {
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) C[3 * r + c] = A[3 * r] * B[c] + A[3 * r + 1] * B[3 + c] + A[3 * r + 2] * B[6 + c];
}

/* ---- poses of joints, and sags of cells; both stored by their times */

/* Number the frames that pairs need. */
static void number_spans(Search *s) {
    memset(s->span, 255, sizeof s->span);
    for (int m = 0; m < MAX_JOINTS; m++) s->farthest[m] = (int8_t)m, s->nearest[m + 1] = (int8_t)(m + 1);
    for (int i = 0; i < s->step.pairs; i++) {
        int m = s->pairs[i].m, k = s->pairs[i].k;
        if (m == k || s->span[m][k] >= 0) continue;
        s->span[m][k] = (int16_t)s->spans++;
        if (k > s->farthest[m]) s->farthest[m] = (int8_t)k;
        if (m < s->nearest[k]) s->nearest[k] = (int8_t)m;
    }
}

/* The outer frame of a pair seen from the inner one at an instant. */
static inline const Frame *frame_of(const Search *s, const Pair *pair, int at) {
    return s->frames + (size_t)s->spans * at + s->span[pair->m][pair->k];
}

/* How many of the first `count` increasing times are at most t. */
static int until(const double *times, int count, double t) {
    int low = 0, high = count;
    while (low < high) {
        int middle = (low + high) / 2;
        if (times[middle] <= t) low = middle + 1; else high = middle;
    }
    return low;
}

/* The piece of the motion at an instant. */
static int piece_of(const Step *s, double t) {
    int number = until(s->t, s->pieces, t) - 1;
    return number < 0 ? 0 : number;
}

static void configuration(const Step *s, double t, double *q) {
    if (!s->pieces) {
        memcpy(q, s->derivatives, s->joints * sizeof(double));
        return;
    }
    int piece = piece_of(s, t), order = s->orders - 1, joints = s->joints;
    const double *own = s->derivatives + joints * s->orders * piece;
    double d = t - s->t[piece];
    memcpy(q, own + joints * order, joints * sizeof(double));
    while (order > 0) {
        double factor = d / order--;
        for (int i = 0; i < joints; i++) q[i] = own[joints * order + i] + factor * q[i];
    }
}

/* Where a cell is cut: at the kink inside that is nearest to its middle, or there. */
static double cut_of(const Step *s, double start, double end) {
    double middle = 0.5 * (start + end);
    int first = until(s->kinks_s, s->kinks, start), after = until(s->kinks_s, s->kinks, middle);
    if (after > first && s->kinks_s[after - 1] == middle) return middle;
    int has_before = after > first, has_after = after < s->kinks && s->kinks_s[after] < end;
    if (has_before && has_after)
        return middle - s->kinks_s[after - 1] <= s->kinks_s[after] - middle ? s->kinks_s[after - 1] : s->kinks_s[after];
    return has_before ? s->kinks_s[after - 1] : has_after ? s->kinks_s[after] : middle;
}

/* All frames that pairs need, with the joints at q. */
static void place_at(const Search *s, const double *q, Frame *frames) {
    const Step *step = &s->step;
    double turns[MAX_JOINTS][9];
    Frame others[2];
    for (int i = 0; i < step->joints; i++) {
        double c = cos(q[i]), d = sin(q[i]);
        for (int r = 0; r < 3; r++) {
            const double *R = step->spans_R + 9 * i + 3 * r;
            double *T = turns[i] + 3 * r;
            T[0] = R[0] * c + R[1] * d;
            T[1] = R[1] * c - R[0] * d;
            T[2] = R[2];
        }
    }
    for (int m = 0; m < step->joints; m++) {
        const Frame *before = NULL;
        for (int k = m + 1; k <= s->farthest[m]; k++) {
            const double *p = step->spans_p + 3 * (k - 1);
            Frame *now = s->span[m][k] < 0 ? &others[k & 1] : frames + s->span[m][k];
            if (before) {
                product(before->R, turns[k - 1], now->R);
                turned(before->R, p, now->p);
                for (int r = 0; r < 3; r++) now->p[r] += before->p[r];
            } else {
                memcpy(now->R, turns[m], sizeof turns[m]);
                copy(p, now->p);
            }
            before = now;
        }
    }
}

static int32_t *slot(int32_t *table, uint64_t key) { return table + (key * 0x9E3779B97F4A7C15ull >> 50); }
static int32_t *next_slot(int32_t *table, int32_t *at) { return at + 1 == table + TABLE ? table : at + 1; }

static void *grown(void *array, int count, int *room, size_t size) {
    if (count < *room) return array;
    *room = *room ? 2 * *room : 256;
    return realloc(array, size * *room);
}

/* The number of an instant; -1 when there are too many. */
static int instant(Search *s, double t) {
    uint64_t bits;
    memcpy(&bits, &t, sizeof bits);
    int32_t *at = slot(s->instant_table, bits);
    for (; *at >= 0; at = next_slot(s->instant_table, at))
        if (s->times[*at] == t) return *at;
    if (s->instant_count >= 3 * (TABLE / 4)) return -1;
    size_t size = (s->spans + 1) * sizeof(Frame); /* + 1: the count may be 0 */
    Frame *larger = grown(s->frames, s->instant_count, &s->instant_room, size);
    if (!larger) return -1;
    s->frames = larger;
    double q[MAX_JOINTS];
    configuration(&s->step, t, q);
    place_at(s, q, s->frames + (size_t)s->spans * s->instant_count);
    s->times[s->instant_count] = t;
    return *at = s->instant_count++;
}

/* Maximum sags of gaps in a cell, for each pair of frames; NULL when there are too many cells. */
static const Sag *cell(Search *s, int start, int end) {
    int32_t *at = slot(s->cell_table, (uint64_t)start << 32 | (uint32_t)end);
    for (; *at >= 0; at = next_slot(s->cell_table, at))
        if (s->cells[*at].start == start && s->cells[*at].end == end) return s->sags + (size_t)s->spans * *at;
    if (s->cell_count >= 3 * (TABLE / 4)) return NULL;
    size_t size = (s->spans + 1) * sizeof(Sag);
    Sag *larger = grown(s->sags, s->cell_count, &s->cell_room, size);
    if (!larger) return NULL;
    s->sags = larger;
    *at = s->cell_count++;
    Sag *sags = s->sags + (size_t)s->spans * *at;
    s->cells[*at] = (Cell){start, end};
    const Step *step = &s->step;
    int joints = step->joints;
    double begin = s->times[start], until_s = s->times[end], length = until_s - begin;
    double eighth = length * length / 8 * (1 + 1e-8), quarter = length / 4 * (1 + 1e-8);
    double V[MAX_JOINTS] = {0}, A[MAX_JOINTS] = {0}, J[MAX_JOINTS] = {0}, both[MAX_JOINTS];
    for (int g = piece_of(step, begin); g < step->pieces && step->t[g] < until_s; g++)
        for (int i = 0; i < joints; i++) {
            V[i] = fmax(V[i], step->v_peak[joints * g + i]);
            A[i] = fmax(A[i], step->a_peak[joints * g + i]);
        }
    for (int g = until(step->kinks_s, step->kinks, begin); g < step->kinks && step->kinks_s[g] < until_s; g++)
        for (int i = 0; i < joints; i++) J[i] += step->jumps[joints * g + i];
    for (int i = 0; i < joints; i++) both[i] = sqrt(V[i] * V[i] * V[i] * V[i] + A[i] * A[i]);
    for (int k = 1; k <= joints; k++) {
        double u[2] = {0, 0}, w[2] = {0, 0}, jump[2] = {0, 0}, lever = 0; /* [1]: by reach */
        for (int i = k - 1; i >= s->nearest[k]; i--) {
            w[0] += 2 * V[i] * u[0] + both[i] * lever;
            w[1] += 2 * V[i] * u[1] + both[i];
            u[0] += V[i] * lever;
            u[1] += V[i];
            jump[0] += J[i] * lever;
            jump[1] += J[i];
            lever += step->offsets[i];
            if (s->span[i][k] >= 0)
                sags[s->span[i][k]] = (Sag){w[0] * eighth + jump[0] * quarter, w[1] * eighth + jump[1] * quarter};
        }
    }
    return sags;
}

/* ---- clusters */

static int is_leaf(const Search *s, Cluster c) {
    const Placed *placed = &s->placed[c.tree];
    return placed->joined[0] < 0 && s->trees[placed->tree].children[2 * c.node] < 0;
}

static Cluster child(const Search *s, Cluster c, int side) {
    const Placed *placed = &s->placed[c.tree];
    if (placed->joined[0] >= 0) return (Cluster){placed->joined[side], 0};
    return (Cluster){c.tree, s->trees[placed->tree].children[2 * c.node + side]};
}

static void box_of(const Search *s, Cluster c, double *low, double *high) {
    const Placed *placed = &s->placed[c.tree];
    const Tree *tree = &s->trees[placed->tree];
    for (int i = 0; i < 3; i++) low[i] = tree->low[3 * c.node + i], high[i] = tree->high[3 * c.node + i];
    for (int i = 0; i < 3 && placed->has_apex; i++) {
        low[i] = fmin(low[i], placed->apex[i]);
        high[i] = fmax(high[i], placed->apex[i]);
    }
}

static double extent_of(const Search *s, Cluster c) {
    double low[3], high[3];
    box_of(s, c, low, high);
    double x[3] = {high[0] - low[0], high[1] - low[1], high[2] - low[2]};
    return norm(x);
}

/* The middle of a cluster's box, in the frame that carries it; as in the checker. */
static void middle_of(const Search *s, Cluster c, double *x) {
    const Placed *placed = &s->placed[c.tree];
    double low[3], high[3], own[3];
    box_of(s, c, low, high);
    for (int i = 0; i < 3; i++) own[i] = 0.5 * (low[i] + high[i]);
    turned(placed->R, own, x);
    for (int i = 0; i < 3; i++) x[i] += placed->p[i];
}

static double reach_of(const Search *s, Cluster c) {
    const Placed *placed = &s->placed[c.tree];
    double own = s->trees[placed->tree].reach[c.node];
    if (placed->has_apex) own = fmax(own, norm(placed->apex));
    return own + placed->ball + placed->disc + norm(placed->p);
}

/* The cell of a direction: a face of the cube, then a quadrant of a quadrant. */
static int cell_of(const double *d) {
    int axis = fabs(d[1]) > fabs(d[0]) ? 1 : 0;
    if (fabs(d[2]) > fabs(d[axis])) axis = 2;
    double u = d[(axis + 1) % 3] / fabs(d[axis]), v = d[(axis + 2) % 3] / fabs(d[axis]), size = 1;
    int number = 2 * axis + (d[axis] < 0);
    for (int i = 0; i < HALVINGS; i++) {
        size /= 2;
        number = 4 * number + 2 * (u > 0) + (v > 0);
        u += u > 0 ? -size : size, v += v > 0 ? -size : size;
    }
    return number;
}

/* The smallest d . x over a node with lists, by the list of d's cell; and a point with it. */
static double lowest_listed(const Tree *tree, int node, const double *d, double *at) {
    const float *x = tree->x + tree->first[node], *y = tree->y + tree->first[node], *z = tree->z + tree->first[node];
    int cell = tree->lists[node] + cell_of(d), count = tree->begins[cell + 1] - tree->begins[cell], j = 0;
    const uint16_t *listed = tree->listed + tree->begins[cell];
    double best = FAR;
    for (int i = 0; i < count; i++) {
        int p = listed[i];
        double value = x[p] * d[0] + y[p] * d[1] + z[p] * d[2];
        best = value < best ? value : best;
    }
    if (at) {
        while (j < count - 1 && x[listed[j]] * d[0] + y[listed[j]] * d[1] + z[listed[j]] * d[2] > best + 1e-13) j++;
        at[0] = x[listed[j]], at[1] = y[listed[j]], at[2] = z[listed[j]];
    }
    return best;
}

/* The same for any node, by all its points. */
static double lowest_of_all(const Tree *tree, int node, const double *d, double *at) {
    const float *x = tree->x + tree->first[node], *y = tree->y + tree->first[node], *z = tree->z + tree->first[node];
    int count = tree->count[node], i = 0;
    double best = FAR;
    if (count >= LANES) {
        double low[LANES];
        for (int l = 0; l < LANES; l++) low[l] = FAR;
        for (; i + LANES <= count; i += LANES)
            for (int l = 0; l < LANES; l++) {
                double value = x[i + l] * d[0] + y[i + l] * d[1] + z[i + l] * d[2];
                low[l] = value < low[l] ? value : low[l];
            }
        for (int l = 0; l < LANES; l++) best = low[l] < best ? low[l] : best;
    }
    for (; i < count; i++) {
        double value = x[i] * d[0] + y[i] * d[1] + z[i] * d[2];
        best = value < best ? value : best;
    }
    if (at) {
        i = 0;
        while (i < count - 1 && x[i] * d[0] + y[i] * d[1] + z[i] * d[2] > best + 1e-13) i++;
        at[0] = x[i], at[1] = y[i], at[2] = z[i];
    }
    return best;
}

/* The smallest d . x over a cluster without its ball, d in its tree's frame; and a point with it. */
static double lowest(const Search *s, Cluster c, const double *d, double *at) {
    const Placed *placed = &s->placed[c.tree];
    const Tree *tree = &s->trees[placed->tree];
    double best = tree->lists[c.node] < 0 ? lowest_of_all(tree, c.node, d, at) : lowest_listed(tree, c.node, d, at);
    if (placed->has_apex && dot(placed->apex, d) < best) {
        best = dot(placed->apex, d);
        if (at) copy(placed->apex, at);
    }
    if (placed->disc > 0) {
        double across = sqrt(d[0] * d[0] + d[1] * d[1]);
        best -= placed->disc * across;
        if (at && across > 0)
            for (int i = 0; i < 2; i++) at[i] -= placed->disc * d[i] / across;
    }
    return best;
}

/* ---- two clusters at one or both ends of a cell, seen from the frame that carries the second */

typedef struct {
    Cluster a, b;
    int ends;
    double Ra[2][9], pa[2][3], Rb[9], pb[3], ball;
} View;

static void place_first(const Search *s, const Task *task, int at, double *R, double *p) {
    const Pair *pair = &s->pairs[task->pair];
    const Placed *placed = &s->placed[task->a.tree];
    double share = s->times[at] / s->step.duration, x[3];
    copy(placed->p, x);
    x[1] += pair->slides[0] * (1 - share) + pair->slides[1] * share;
    if (pair->m == pair->k) {
        x[1] -= pair->slides[2] * (1 - share) + pair->slides[3] * share;
        memcpy(R, placed->R, sizeof placed->R);
        copy(x, p);
        return;
    }
    const Frame *T = frame_of(s, pair, at);
    product(T->R, placed->R, R);
    turned(T->R, x, p);
    for (int i = 0; i < 3; i++) p[i] += T->p[i];
}

static View view_of(const Search *s, const Task *task) {
    View v = {.a = task->a, .b = task->b, .ends = task->start == task->end ? 1 : 2};
    const Placed *second = &s->placed[task->b.tree];
    place_first(s, task, task->start, v.Ra[0], v.pa[0]);
    if (v.ends == 2) place_first(s, task, task->end, v.Ra[1], v.pa[1]);
    memcpy(v.Rb, second->R, sizeof second->R);
    copy(second->p, v.pb);
    v.ball = s->placed[task->a.tree].ball + second->ball;
    return v;
}

/* The gap of n at the worse end, times |n|; and the point of the difference there. */
static double gap(const Search *s, const View *v, const double *n, double *difference) {
    double d[3], reversed[3] = {-n[0], -n[1], -n[2]}, x[3], nearest[3] = {0}, best = INFINITY;
    for (int end = 0; end < v->ends; end++) {
        turned_back(v->Ra[end], n, d);
        double found = lowest(s, v->a, d, difference ? x : NULL) + dot(n, v->pa[end]);
        if (found >= best) continue;
        best = found;
        if (!difference) continue;
        turned(v->Ra[end], x, nearest);
        for (int i = 0; i < 3; i++) nearest[i] += v->pa[end][i];
    }
    turned_back(v->Rb, reversed, d);
    best += lowest(s, v->b, d, difference ? x : NULL) - dot(n, v->pb);
    if (difference) {
        double far[3];
        turned(v->Rb, x, far);
        for (int i = 0; i < 3; i++) difference[i] = nearest[i] - far[i] - v->pb[i];
    }
    return best - v->ball * norm(n);
}

/* ---- Gilbert, Johnson and Keerthi */

/* The point of a simplex nearest to the origin; keeps the corners with weights, returns their number. */
static int nearest_to_origin(double corners[4][3], int count, double *nearest) {
    static const int subsets[15][5] = {/* size, corners */
        {1, 0}, {1, 1}, {1, 2}, {1, 3}, {2, 0, 1}, {2, 0, 2}, {2, 1, 2}, {2, 0, 3}, {2, 1, 3}, {2, 2, 3},
        {3, 0, 1, 2}, {3, 0, 1, 3}, {3, 0, 2, 3}, {3, 1, 2, 3}, {4, 0, 1, 2, 3}};
    double least = INFINITY, kept[4][3];
    int chosen = 0;
    for (int number = 0; number < 15; number++) {
        int size = subsets[number][0];
        const int *of = subsets[number] + 1;
        if (of[size - 1] >= count) continue;
        const double *A = corners[of[0]];
        double e[3][3], p[3];
        for (int j = 1; j < size; j++)
            for (int i = 0; i < 3; i++) e[j - 1][i] = corners[of[j]][i] - A[i];
        int is_inside = 1;
        if (size == 1) {
            copy(A, p);
        } else if (size == 2) {
            double ee = dot(e[0], e[0]), share = ee > 1e-24 ? -dot(A, e[0]) / ee : -1;
            is_inside = share > 0 && share < 1;
            for (int i = 0; i < 3; i++) p[i] = A[i] + share * e[0][i];
        } else if (size == 3) {
            double ee = dot(e[0], e[0]), ff = dot(e[1], e[1]), ef = dot(e[0], e[1]);
            double ae = -dot(A, e[0]), af = -dot(A, e[1]), det = ee * ff - ef * ef;
            if (det <= 1e-12 * ee * ff) continue;
            double first = (ae * ff - af * ef) / det, second = (af * ee - ae * ef) / det;
            is_inside = first > 0 && second > 0 && first + second < 1;
            for (int i = 0; i < 3; i++) p[i] = A[i] + first * e[0][i] + second * e[1][i];
        } else {
            double sum = 0, scale = norm(e[0]) * norm(e[1]) * norm(e[2]);
            for (int j = 0; j < 3 && is_inside; j++) {
                const double *f = e[(j + 1) % 3], *g = e[(j + 2) % 3];
                double across[3] = {f[1] * g[2] - f[2] * g[1], f[2] * g[0] - f[0] * g[2], f[0] * g[1] - f[1] * g[0]};
                double det = dot(e[j], across), share = -dot(A, across) / det;
                is_inside = fabs(det) > 1e-12 * scale && share > 0;
                sum += share;
            }
            is_inside = is_inside && sum < 1;
            p[0] = p[1] = p[2] = 0;
        }
        if (is_inside && dot(p, p) < least) least = dot(p, p), chosen = number, copy(p, nearest);
    }
    int size = subsets[chosen][0];
    for (int j = 0; j < size; j++) copy(corners[subsets[chosen][j + 1]], kept[j]);
    memcpy(corners, kept, size * sizeof *kept);
    return size;
}

/* The nearest direction of integers up to 127. */
static void whole(const double *d, int16_t *n) {
    double top = fmax(fabs(d[0]), fmax(fabs(d[1]), fabs(d[2]))), best = -1;
    for (int scale = 127; scale > 96; scale--) {
        double m[3], factor = scale / top;
        for (int i = 0; i < 3; i++) m[i] = rounded(d[i] * factor);
        double along = dot(m, d) / norm(m);
        if (along <= best + 1e-12) continue;
        best = along;
        for (int i = 0; i < 3; i++) n[i] = (int16_t)m[i];
    }
}

typedef struct {         /* the result of a search for a direction */
    double d[3];         /* first the start of the search; then the best direction, of any length */
    double least;        /* the distance is at most this */
    int16_t n[3];        /* a separating direction of integers */
    double kept;         /* its gap at the instants of the view */
} Found;

static int keeps(const Search *s, const View *v, double goal, Found *f) {
    double n[3] = {f->n[0], f->n[1], f->n[2]};
    f->kept = gap(s, v, n, NULL) / norm(n);
    return f->kept > goal + s->step.spare;
}

static int separates(const Search *s, const View *v, const double *d, double goal, Found *f) {
    whole(d, f->n);
    return keeps(s, v, goal, f);
}

/* The same for integers up to 32767, which large clusters near each other need. */
static int separates_finely(const Search *s, const View *v, const double *d, double goal, Found *f) {
    double factor = 32767 / fmax(fabs(d[0]), fmax(fabs(d[1]), fabs(d[2])));
    for (int i = 0; i < 3; i++) f->n[i] = (int16_t)rounded(d[i] * factor);
    return keeps(s, v, goal, f);
}

/* Whether a direction leaves more than the goal: one of integers for rows, any at an instant. */
static int separated(const Search *s, const View *v, double goal, Found *f) {
    int for_rows = v->ends == 2, size = 1;
    double simplex[4][3], p[3], w[3];
    double best = gap(s, v, f->d, simplex[0]) / norm(f->d);
    f->least = FAR;
    if (!for_rows && best > goal) return 1;
    copy(simplex[0], p);
    for (int iteration = 0; iteration < ITERATIONS; iteration++) {
        double length = norm(p), distance = length - v->ball;
        f->least = fmin(f->least, distance);
        if (length < 1e-9) return 0;
        double u[3] = {p[0] / length, p[1] / length, p[2] / length}, kept = gap(s, v, u, w);
        if (kept > best) best = kept, copy(u, f->d);
        if (kept > goal && (!for_rows || (kept > goal + s->step.spare && separates(s, v, u, goal, f)))) return 1;
        if (for_rows && f->least <= goal) return 0;
        if (distance - kept < 1e-7 + CONVERGED * fabs(distance - goal)) return 0;
        for (int i = 0; i < size; i++)
            if (fabs(simplex[i][0] - w[0]) + fabs(simplex[i][1] - w[1]) + fabs(simplex[i][2] - w[2]) < 1e-12) return 0;
        copy(w, simplex[size]);
        size = nearest_to_origin(simplex, size + 1, p);
        if (size == 4) {
            f->least = -v->ball;
            return 0;
        }
    }
    return 0;
}

/* From the middle of the second cluster to that of the first, at an instant. */
static void between(const Search *s, const Task *task, int at, double *x) {
    const Pair *pair = &s->pairs[task->pair];
    double first[3], second[3], share = s->times[at] / s->step.duration;
    middle_of(s, task->a, first);
    middle_of(s, task->b, second);
    first[1] += pair->slides[0] * (1 - share) + pair->slides[1] * share;
    second[1] += pair->slides[2] * (1 - share) + pair->slides[3] * share;
    copy(first, x);
    if (pair->k > pair->m) {
        const Frame *T = frame_of(s, pair, at);
        turned(T->R, first, x);
        for (int i = 0; i < 3; i++) x[i] += T->p[i];
    }
    for (int i = 0; i < 3; i++) x[i] -= second[i];
}

/* The line between the middles, rounded as by the checker; whether the rounding surely agrees. */
static int between_middles(const Search *s, const Task *task, double *n) {
    double x[3], top = 1e-9;
    int is_sure = 1;
    between(s, task, task->start, x);
    for (int i = 0; i < 3; i++) top = fmax(top, fabs(x[i]));
    for (int i = 0; i < 3; i++) {
        double value = 100 * (x[i] / top);
        n[i] = rounded(value);
        is_sure = is_sure && fabs(fabs(value - n[i]) - 0.5) > 1e-6;
    }
    if (n[0] == 0 && n[1] == 0 && n[2] == 0) n[2] = 1;
    return is_sure;
}

/* The gap of n between balls around both clusters, times |n|, at an instant. */
static double ball_gap(const Search *s, const Task *task, int at, const double *n) {
    double x[3], radii = 0.5 * (extent_of(s, task->a) + extent_of(s, task->b));
    between(s, task, at, x);
    for (int side = 0; side < 2; side++) {
        const Placed *placed = &s->placed[side ? task->b.tree : task->a.tree];
        radii += placed->ball + placed->disc;
    }
    return dot(n, x) - radii * norm(n);
}

/* ---- distances at an instant */

static void take_nearer(Search *s, int pair, double t, double distance) {
    Result *r = s->result;
    if (!s->pairs[pair].is_counted || distance >= r->nearest) return;
    r->nearest = distance, r->nearest_pair = pair, r->nearest_s = t;
}

static int refuse(Search *s, int pair, double t, double distance, int code) {
    s->result->found_pair = pair, s->result->found_s = t, s->result->found = distance;
    return code;
}

/* Intended contacts may press; axes separate pairs that may touch best. */
static int may_press(const Pair *pair) { return !pair->is_counted && pair->least < 0; }
static int may_touch(const Pair *pair) { return !pair->is_counted && pair->least <= 0; }

static double needed(const Search *s, int pair) {
    return s->pairs[pair].is_counted ? fmax(s->pairs[pair].least, s->step.margin) : s->pairs[pair].least;
}

/* The distance of two clusters at an instant if it is below `within`, nearer children first. */
static double measured_between(const Search *s, int pair, Cluster first, Cluster second, int at, double within, double *d) {
    struct { Cluster a, b; double d[3], low; } stack[STACK], made[2];
    int count = 1;
    stack[0].a = first;
    stack[0].b = second;
    stack[0].low = -1;
    copy(d, stack[0].d);
    while (count) {
        count--;
        if (stack[count].low >= within) continue;
        Cluster a = stack[count].a, b = stack[count].b;
        int ends[2] = {is_leaf(s, a), is_leaf(s, b)}, sides = ends[0] && ends[1] ? 1 : 2, kept = 0;
        int cuts_first = ends[1] || (!ends[0] && extent_of(s, a) > extent_of(s, b));
        for (int side = 0; side < sides; side++) {
            Task task = {.pair = pair, .start = at, .end = at, .a = a, .b = b};
            if (sides == 2 && cuts_first) task.a = child(s, a, side);
            if (sides == 2 && !cuts_first) task.b = child(s, b, side);
            View v = view_of(s, &task);
            Found f;
            copy(stack[count].d, f.d);
            if (separated(s, &v, within, &f)) continue;
            if (is_leaf(s, task.a) && is_leaf(s, task.b)) {
                while (f.least < within) { /* the farther the goal, the less accurate the distance */
                    double before = within;
                    within = f.least, copy(f.d, d);
                    if (within <= 0) return within;
                    if (before < 1.01 * within) break;
                    separated(s, &v, within, &f);
                }
                continue;
            }
            made[kept].a = task.a, made[kept].b = task.b;
            copy(f.d, made[kept].d);
            made[kept].low = f.least > 0 ? gap(s, &v, f.d, NULL) / norm(f.d) : -1;
            kept++;
        }
        if (count + kept > STACK) return within;
        int order = kept == 2 && made[0].low < made[1].low; /* the nearer comes last, as it is taken first */
        for (int i = 0; i < kept; i++) stack[count++] = made[order ? 1 - i : i];
    }
    return within;
}

/* The same for a whole pair. */
static double measured(const Search *s, int pair, int at, double within, double *d) {
    const Pair *of = &s->pairs[pair];
    return measured_between(s, pair, (Cluster){of->first, 0}, (Cluster){of->second, 0}, at, within, d);
}

static int is_new(Search *s, int pair, int at) {
    int32_t key = (int32_t)((uint32_t)pair << 16 | (uint32_t)at), *place = slot(s->measured_table, (uint32_t)key);
    for (int i = 0; i < 64; i++, place = next_slot(s->measured_table, place)) {
        if (*place == key) return 0;
        if (*place < 0) {
            *place = key;
            return 1;
        }
    }
    return 0;
}

typedef struct { double low, d[3]; int pair, at; } Look;

static int by_low(const void *a, const void *b) {
    double x = ((const Look *)a)->low, y = ((const Look *)b)->low;
    return (x > y) - (x < y);
}

/* Measure both ends, the nearest pairs first: this determines what can be asked for. */
static int look_at_ends(Search *s, const Task *tasks, int count) {
    Look *looks = malloc(2 * sizeof(Look) * ((size_t)count + 1));
    if (!looks) return TOO_MUCH;
    int made = 0, code = PROVEN;
    for (int i = 0; i < count; i++) {
        if (may_press(&s->pairs[i])) continue;
        for (int end = 0; end < 2; end++) {
            Look *look = &looks[made++];
            Task task = tasks[i];
            task.start = task.end = look->at = end ? tasks[i].end : tasks[i].start;
            look->pair = i;
            between_middles(s, &task, look->d);
            look->low = ball_gap(s, &task, task.start, look->d) / norm(look->d);
        }
    }
    qsort(looks, made, sizeof(Look), by_low);
    for (int j = 0; j < made && code == PROVEN; j++) {
        int pair = looks[j].pair;
        double need = needed(s, pair), t = s->times[looks[j].at];
        double within = (s->pairs[pair].is_counted ? fmax(need, s->result->nearest) : need) + 1e-9;
        if (looks[j].low >= within) continue;
        double distance = measured(s, pair, looks[j].at, within, looks[j].d);
        if (distance <= need) code = refuse(s, pair, t, distance, TOO_NEAR);
        take_nearer(s, pair, t, distance);
    }
    free(looks);
    return code;
}

/* ---- rows */

/* The required conclusion of a row of a pair, as known so far. */
static double asked(const Search *s, int pair) {
    double need = needed(s, pair);
    return s->pairs[pair].is_counted ? fmax(need, s->step.share * s->result->nearest) : need;
}

/* Whether a direction separates after it is turned repeatedly towards the point of its smallest gap.
   The gap is a concave function of d, with the point of the difference as its slope; the steps are
   Polyak's, for a little more than the goal. */
static int climbed(const Search *s, const View *v, const double *from, double goal, Found *f) {
    double d[3], best = -FAR, target = goal + 0.1 * fabs(goal) + 10 * s->step.spare;
    copy(from, d);
    for (int iteration = 0; iteration < CLIMBS; iteration++) {
        double w[3], length = norm(d);
        for (int i = 0; i < 3; i++) d[i] /= length;
        double kept = gap(s, v, d, w), along = dot(d, w);
        if (kept > best) best = kept, copy(d, f->d);
        if (kept > goal + s->step.spare && separates(s, v, d, goal, f)) return 1;
        for (int i = 0; i < 3; i++) w[i] -= along * d[i];
        double slope = dot(w, w);
        if (slope < 1e-12) return 0;
        for (int i = 0; i < 3; i++) d[i] += (target - kept) / slope * w[i];
    }
    return 0;
}

/* The axes of both shapes, or of the frames that carry them, separate intended contacts best. */
static int separated_by_axes(const Search *s, const Task *task, const View *v, double goal, Found *f) {
    static const double unturned[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    const Pair *pair = &s->pairs[task->pair];
    const double *carrier = pair->k > pair->m ? frame_of(s, pair, task->start)->R : unturned;
    const double *frames[] = {v->Rb, v->Ra[0], v->Ra[v->ends - 1], carrier, unturned};
    Found best = {.kept = -FAR};
    double start[3] = {0, 0, 1}, least = -FAR;
    for (int frame = 0; frame < 5; frame++)
        for (int axis = 0; axis < 3; axis++)
            for (int sign = -1; sign <= 1; sign += 2) {
                const double *R = frames[frame];
                double d[3] = {sign * R[axis], sign * R[3 + axis], sign * R[6 + axis]};
                if (separates(s, v, d, goal, f) && f->kept > best.kept) best = *f;
                if (f->kept > least) least = f->kept, copy(d, start);
            }
    if (best.kept == -FAR) return climbed(s, v, start, goal, f);
    *f = best;
    return 1;
}

/* Maximum sag of a gap in the cell of a task; -1 when there are too many cells. */
static double sag_of(Search *s, const Task *task) {
    const Pair *pair = &s->pairs[task->pair];
    if (!s->step.pieces) return 0;
    if (pair->k == pair->m) return s->step.slack;
    const Sag *sags = cell(s, task->start, task->end);
    if (!sags) return -1;
    const Sag *sag = sags + s->span[pair->m][pair->k];
    double reach = reach_of(s, task->a) + fmax(fabs(pair->slides[0]), fabs(pair->slides[1]));
    return s->step.slack + sag->fixed + sag->by_reach * reach;
}

/* A letter for one task; sets *code when the search ends. */
static int letter_of(Search *s, Task *task, double sag, Found *f, int *code) {
    const Pair *pair = &s->pairs[task->pair];
    double start = s->times[task->start], end = s->times[task->end], n[3];
    int is_sure = between_middles(s, task, n);
    if (is_sure) {
        f->kept = fmin(ball_gap(s, task, task->start, n), ball_gap(s, task, task->end, n)) / norm(n);
        if (f->kept > asked(s, task->pair) + sag + s->step.spare) return BY_MIDDLES;
    }
    View v = view_of(s, task);
    for (;;) {
        double goal = asked(s, task->pair) + sag;
        if (task->has_n && separates(s, &v, task->n, goal, f)) return BY_DIRECTION;
        if (is_sure && (f->kept = gap(s, &v, n, NULL) / norm(n)) > goal + s->step.spare) return BY_MIDDLES;
        copy(task->has_n ? task->n : n, f->d);
        if (separated(s, &v, goal, f)) return BY_DIRECTION;
        if (may_touch(pair) && sag < TOUCHING_SAG_M && separated_by_axes(s, task, &v, goal, f)) return BY_DIRECTION;
        if (separates_finely(s, &v, f->d, goal, f)) return BY_FINE_DIRECTION;

        int middle = instant(s, cut_of(&s->step, start, end));
        if (middle < 0) return *code = TOO_MUCH, NONE;
        Task now = *task;
        now.start = now.end = middle;
        View inside = view_of(s, &now);
        double apart = asked(s, task->pair) + fmin(0.25 * sag, APART_M);
        int is_apart = separated(s, &inside, apart, f);
        task->has_n = 1;
        copy(f->d, task->n);
        if (!is_apart && !may_press(pair) && is_new(s, task->pair, middle)) { /* measure the distance */
            double need = needed(s, task->pair), time = s->times[middle], d[3];
            double within = (pair->is_counted ? fmax(s->result->nearest, need) : need) + 1e-9;
            now.a = (Cluster){pair->first, 0}, now.b = (Cluster){pair->second, 0};
            between_middles(s, &now, d);
            double distance = measured(s, task->pair, middle, within, d);
            if (distance <= need) return *code = refuse(s, task->pair, time, distance, TOO_NEAR), NONE;
            if (pair->is_counted && distance < s->result->nearest) {
                take_nearer(s, task->pair, time, distance);
                continue; /* the requirement is lower now */
            }
        }
        double first = is_leaf(s, task->a) ? 0 : extent_of(s, task->a), second = is_leaf(s, task->b) ? 0 : extent_of(s, task->b);
        int is_whole = first == 0 && second == 0;
        if (is_whole && may_press(pair) && !is_apart) { /* may be pressed in too deep */
            double need = needed(s, task->pair), time = s->times[middle];
            if (!separates_finely(s, &inside, f->d, need, f) && !separated_by_axes(s, &now, &inside, need, f))
                return *code = refuse(s, task->pair, time, f->kept, NOT_SHOWN), NONE;
        }
        int is_late = (is_apart && sag > MIN_SAG_M) || LARGE_SAG * sag > fmax(first, second) || is_whole;
        double shortest = s->step.pieces ? MIN_CELL_S : MIN_TRAVEL;
        if (is_late && (sag > s->step.slack || is_whole) && end - start > shortest) return CUT_TIME;
        if (is_whole) return *code = refuse(s, task->pair, s->times[middle], is_apart ? apart : f->least, NOT_SHOWN), NONE;
        return first >= second ? CUT_FIRST : CUT_SECOND;
    }
}

/* The halves of all cut tasks, in the checker's order; their number, or -1 when too many. */
static int halves(Search *s, const Task *tasks, const uint8_t *letters, int count, Task *made) {
    int number = 0;
    for (int side = 0; side < 2; side++)
        for (int letter = CUT_FIRST; letter <= CUT_TIME; letter++)
            for (int i = 0; i < count; i++) {
                if (letters[i] != letter) continue;
                if (number == MAX_TASKS) return -1;
                Task task = tasks[i];
                if (letter == CUT_FIRST) task.a = child(s, task.a, side);
                if (letter == CUT_SECOND) task.b = child(s, task.b, side);
                if (letter == CUT_TIME) {
                    int middle = instant(s, cut_of(&s->step, s->times[task.start], s->times[task.end]));
                    if (middle < 0) return -1;
                    if (side) task.start = middle; else task.end = middle;
                }
                made[number++] = task;
            }
    return number;
}

static int levels(Search *s, Task *tasks, Task *next, uint8_t *letters, int8_t *directions,
                  int16_t *fine, int64_t room) {
    Result *r = s->result;
    int count = s->step.pairs;
    if (count > MAX_TASKS) return TOO_MUCH;
    for (int i = 0; i < count; i++) {
        const Pair *pair = &s->pairs[i];
        tasks[i] = (Task){.pair = i, .a = {pair->first, 0}, .b = {pair->second, 0}};
        tasks[i].start = instant(s, pair->begin), tasks[i].end = instant(s, pair->end);
        if (tasks[i].start < 0 || tasks[i].end < 0) return TOO_MUCH;
    }
    int code = look_at_ends(s, tasks, count);
    while (count && code == PROVEN) {
        if (r->tasks + count > room) return TOO_MUCH;
        uint8_t *own = letters + r->tasks;
        for (int i = 0; i < count; i++) {
            Found f;
            double sag = sag_of(s, &tasks[i]);
            if (sag < 0) return TOO_MUCH;
            own[i] = (uint8_t)letter_of(s, &tasks[i], sag, &f, &code);
            if (code != PROVEN) return code;
            if (own[i] > BY_MIDDLES) continue;
            if (own[i] == BY_DIRECTION) {
                for (int a = 0; a < 3; a++) directions[3 * r->directions + a] = (int8_t)f.n[a];
                r->directions++;
            }
            if (own[i] == BY_FINE_DIRECTION) memcpy(fine + 3 * r->fine_directions++, f.n, sizeof f.n);
            if (s->pairs[tasks[i].pair].is_counted) r->proven = fmin(r->proven, f.kept - sag);
        }
        r->tasks += count;
        count = halves(s, tasks, own, count, next);
        if (count < 0) return TOO_MUCH;
        Task *other = tasks;
        tasks = next, next = other;
    }
    return code;
}

typedef struct { const float *x[3]; int32_t *begins, cells; uint16_t *listed; int32_t count, room; } Lists;

/* List the points, of some, that may be lowest along a direction of a cell: a part around (u, v) of a
   face of a cube of directions. A point is left out when it is above another one along all four
   corners of the cell, as heights are linear in between. Returns whether there is room. */
static int list_lowest(Lists *l, int face, double u, double v, double size, const uint16_t *some, int count) {
    int axis = face / 2, a = (axis + 1) % 3, b = (axis + 2) % 3, kept = 0;
    const float *x = l->x[axis], *y = l->x[a], *z = l->x[b];
    double along = face % 2 ? -1 : 1, least = INFINITY, heights[MAX_LISTED];
    uint16_t best = 0, own[MAX_LISTED];
    for (int i = 0; i < count; i++) {
        heights[i] = along * x[some[i]] + u * y[some[i]] + v * z[some[i]];
        if (heights[i] < least) least = heights[i], best = some[i];
    }
    for (int i = 0; i < count; i++) {
        double across = fabs((double)y[some[i]] - y[best]) + fabs((double)z[some[i]] - z[best]);
        own[kept] = some[i], kept += heights[i] - least <= size * across + 1e-9;
    }
    if (size > 1.5 / (1 << HALVINGS)) {
        int is_room = 1;
        for (int c = 0; c < 4; c++)
            is_room = is_room && list_lowest(l, face, u + (c & 2 ? size : -size) / 2, v + (c & 1 ? size : -size) / 2, size / 2, own, kept);
        return is_room;
    }
    if (l->count + kept > l->room) return 0;
    memcpy(l->listed + l->count, own, kept * sizeof *own);
    l->count += kept;
    l->begins[++l->cells] = l->count;
    return 1;
}

/* The lists of all large nodes, as far as there is room. */
static void list_nodes(int32_t nodes, Tree *tree, int32_t room) {
    uint16_t all[MAX_LISTED];
    Lists l = {.begins = tree->begins, .listed = tree->listed, .room = room};
    for (int i = 0; i < MAX_LISTED; i++) all[i] = (uint16_t)i;
    if (room) l.begins[0] = 0;
    for (int32_t node = 0; node < nodes; node++) {
        int32_t count = tree->count[node], at = tree->first[node], before = l.cells, listed = l.count;
        tree->lists[node] = -1;
        if (count < MANY || count > MAX_LISTED) continue;
        l.x[0] = tree->x + at, l.x[1] = tree->y + at, l.x[2] = tree->z + at;
        int is_room = 1;
        for (int face = 0; face < 6; face++) is_room = is_room && list_lowest(&l, face, 0, 0, 1, all, count);
        if (is_room) tree->lists[node] = before; else l.cells = before, l.count = listed;
    }
}

/* Fill in the boxes of a tree that has its points, where the points of each node begin, and the
   lists of large nodes. */
void lay_out(int32_t nodes, Tree *tree, int32_t room) {
    int32_t at = 0;
    for (int32_t node = 0; node < nodes; node++) {
        double low[3] = {FAR, FAR, FAR}, high[3] = {-FAR, -FAR, -FAR}, reach = 0;
        tree->first[node] = at;
        for (int32_t end = at + tree->count[node]; at < end; at++) {
            double x[3] = {tree->x[at], tree->y[at], tree->z[at]}, square = dot(x, x);
            for (int a = 0; a < 3; a++) { /* fmin and fmax would be calls */
                low[a] = x[a] < low[a] ? x[a] : low[a];
                high[a] = x[a] > high[a] ? x[a] : high[a];
            }
            reach = square > reach ? square : reach;
        }
        for (int a = 0; a < 3; a++)
            tree->low[3 * node + a] = (float)low[a], tree->high[3 * node + a] = (float)high[a];
        tree->reach[node] = (float)(sqrt(reach) * (1 + 1e-6));
    }
    list_nodes(nodes, tree, room);
}

int rows_version(void) { return ROWS_VERSION; }

/* Letters and directions of a step, `room` of each at most; returns PROVEN or why not. */
int find_rows(const Tree *trees, const Placed *placed, const Pair *pairs, const Step *step, uint8_t *letters,
              int8_t *directions, int16_t *fine, int64_t room, Result *result) {
    Search s = {.trees = trees, .placed = placed, .pairs = pairs, .step = *step, .result = result};
    *result = (Result){.nearest = FAR, .proven = FAR, .nearest_pair = -1, .found_pair = -1};
    size_t table = TABLE * sizeof(int32_t);
    int32_t *tables = malloc(3 * table);
    s.times = malloc(TABLE * sizeof(double)), s.cells = malloc(TABLE * sizeof(Cell));
    Task *tasks = malloc(2 * MAX_TASKS * sizeof(Task));
    int code = TOO_MUCH;
    if (tables && tasks && s.times && s.cells && step->joints <= MAX_JOINTS) {
        memset(tables, 255, 3 * table);
        number_spans(&s);
        s.instant_table = tables, s.cell_table = tables + TABLE, s.measured_table = tables + 2 * TABLE;
        code = levels(&s, tasks, tasks + MAX_TASKS, letters, directions, fine, room);
    }
    free(tables), free(tasks), free(s.times), free(s.frames), free(s.cells), free(s.sags);
    return code;
}
