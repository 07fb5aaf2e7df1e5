/* Finds rows over boxes of the joint angles of one arm or both; planner.certificate.boxes has the lemma. Compiled
   together with rows.c, whose clusters, views and distances it uses.

   A task is a pair of clusters and a box: what a tube allows each joint between two of its instants,
   or a part of that. It is separated by a direction, fixed in the frame that carries the second
   cluster, or in base where that is between both clusters, when the gap that the direction leaves at the corners of the box, less the sag, is above
   what the pair must keep; else a cluster or the box is cut. Tasks are handled level by level.

   As in rows.c, nothing of it is trusted, and any number of threads may search. */

enum { SEPARATED, BOX_CUT_FIRST, BOX_CUT_SECOND, BOX_CUT_TIME, BOX_CUT_JOINT };
enum { JOINTS = 7, BOTH = 2 * JOINTS, SPANS = BOTH * (BOTH + 1) / 2, CORNERS = 1 << JOINTS, MAX_BOXES = 60000, LOOKS = 9 };

static const double OF_CLUSTERS = 0.1; /* clusters are cut where their hulls cost this share of what the box costs */
static const double OF_MOTION = 0.7;   /* time is halved where motion is this share of the widest joint */

typedef struct {
    int32_t instants, shortest;  /* spans of at most `shortest` cells are marked when not separated */
    int32_t base;                /* number of joints before base; at most 7, as those after it */
    const double *low, *high;    /* shape (instants, joints) */
} Tube;

typedef struct {
    int32_t pair, first, last, has_n;
    Cluster a, b;
    double low[BOTH], high[BOTH], n[3];
} BoxTask;

typedef struct {             /* one call */
    Search s;
    Tube tube;
    double times[2];             /* no time passes in a box */
    Frame frames[2][SPANS];      /* in the middle of a box; at any position */
    int joints;
    double sagging[BOTH];        /* the share of each joint in the sag of the current box */
    double turned[2][3][CORNERS], offset[2][CORNERS], least[CORNERS];
    uint8_t *is_open;
    double *place;               /* position of the joints at the nearest pair */
} Boxes;

typedef struct {             /* gaps at the corners of a box */
    double kept;                 /* the smallest gap */
    int corner;                  /* its corner; bit i is set where joint m + i is at its upper bound */
    double slopes[BOTH];         /* mean change of the gap from the lower to the upper bound of each joint */
} Kept;

static double asked_of_boxes(const Boxes *x) {
    return fmax(x->s.step.margin, x->s.step.share * x->s.result->nearest);
}

static void put_at(Boxes *x, int place, const double *q) {
    place_at(&x->s, q, x->s.frames + (size_t)x->s.spans * place);
}

/* The bounds of a tube between two instants. */
static void hull(const Boxes *x, int first, int last, double *low, double *high) {
    const Tube *tube = &x->tube;
    int joints = x->joints;
    for (int i = 0; i < joints; i++) low[i] = INFINITY, high[i] = -INFINITY;
    for (int at = joints * first; at <= joints * last; at += joints)
        for (int i = 0; i < joints; i++) {
            low[i] = tube->low[at + i] < low[i] ? tube->low[at + i] : low[i];
            high[i] = tube->high[at + i] > high[i] ? tube->high[at + i] : high[i];
        }
}

/* The frame in which the direction of a pair is fixed: base, or the nearest to it of all that the pair passes. */
static int base_of(const Boxes *x, const Pair *pair) {
    int base = x->tube.base;
    return base < pair->m ? pair->m : base > pair->k ? pair->k : base;
}

/* Maximum sag of the gap between corners, the sum of rho w^2 / 8; and maximum motion of both
   clusters from the middle. */
static double sag_of_box(Boxes *x, const BoxTask *task, double *moved) {
    const Pair *pair = &x->s.pairs[task->pair];
    int base = base_of(x, pair);
    double rho = reach_of(&x->s, task->a) + fmax(fabs(pair->slides[0]), fabs(pair->slides[1])), sag = 0;
    *moved = 0;
    for (int i = pair->k - 1; i >= base; i--) {
        double w = task->high[i] - task->low[i];
        sag += x->sagging[i] = rho * w * w / 8 * (1 + 1e-8);
        *moved += rho * w / 2;
        rho += x->s.step.offsets[i];
    }
    rho = reach_of(&x->s, task->b) + fmax(fabs(pair->slides[2]), fabs(pair->slides[3]));
    for (int i = pair->m; i < base; i++) {
        double w = task->high[i] - task->low[i];
        rho += x->s.step.offsets[i];
        sag += x->sagging[i] = rho * w * w / 8 * (1 + 1e-8);
        *moved += rho * w / 2;
    }
    return sag;
}

/* Turn a direction from the frame before joint j to the one after it, or back from there. */
static void turn_past(const Boxes *x, int j, double q, int is_back, const double *d, double *to) {
    const double *S = x->s.step.spans_R + 9 * j;
    double c = cos(q), s = sin(q), y[3];
    if (is_back) {
        y[0] = c * d[0] - s * d[1], y[1] = c * d[1] + s * d[0], y[2] = d[2];
        turned(S, y, to);
    } else {
        turned_back(S, d, y);
        to[0] = c * y[0] + s * y[1], to[1] = c * y[1] - s * y[0], to[2] = y[2];
    }
}

/* A direction in the frame of the second cluster, with the joints in the middle, seen from base, or back. */
static void turn_in_middle(const Boxes *x, const BoxTask *task, int is_back, const double *n, double *to) {
    const Pair *pair = &x->s.pairs[task->pair];
    int base = base_of(x, pair);
    double d[3];
    copy(n, to);
    for (int i = pair->m; i < base; i++) {
        int j = is_back ? base - 1 - (i - pair->m) : i;
        copy(to, d);
        turn_past(x, j, 0.5 * (task->low[j] + task->high[j]), is_back, d, to);
    }
}

/* Turn a direction in base into the frames of the first or the second cluster at all corners of a box; returns their
   number. Bit i of a corner is that of the i-th joint that is passed, counted from base. */
static int turn_to_corners(Boxes *x, const BoxTask *task, const double *n, int is_second, int *side) {
    const Pair *pair = &x->s.pairs[task->pair];
    const Placed *placed = &x->s.placed[is_second ? task->b.tree : task->a.tree];
    int count = 1, now = 0, base = base_of(x, pair), passed = is_second ? base - pair->m : pair->k - base;
    for (int i = 0; i < 3; i++) x->turned[0][i][0] = n[i];
    x->offset[0][0] = 0;
    for (int number = 0; number < passed; number++, now = 1 - now) {
        int j = is_second ? base - 1 - number : base + number;
        const double *S = x->s.step.spans_R + 9 * j, *p = x->s.step.spans_p + 3 * j;
        double (*from)[CORNERS] = x->turned[now], (*to)[CORNERS] = x->turned[1 - now];
        double c[2] = {cos(task->low[j]), cos(task->high[j])}, s[2] = {sin(task->low[j]), sin(task->high[j])};
        for (int i = 0; i < count; i++) {
            double d[3] = {from[0][i], from[1][i], from[2][i]}, y[3], offset = x->offset[now][i];
            if (!is_second) {
                offset += dot(d, p);
                turned_back(S, d, y);
            }
            for (int end = 0; end < 2; end++) {
                int at = end ? count + i : i;
                double out[3];
                if (is_second) {
                    double back[3] = {c[end] * d[0] - s[end] * d[1], c[end] * d[1] + s[end] * d[0], d[2]};
                    turned(S, back, out);
                } else {
                    out[0] = c[end] * y[0] + s[end] * y[1], out[1] = c[end] * y[1] - s[end] * y[0], out[2] = y[2];
                }
                for (int r = 0; r < 3; r++) to[r][at] = out[r];
                x->offset[1 - now][at] = is_second ? offset - dot(out, p) : offset;
            }
        }
        count *= 2;
    }
    double own[3] = {placed->p[0], placed->p[1] + pair->slides[is_second ? 2 : 0], placed->p[2]};
    for (int i = 0; i < count; i++) {
        double d[3] = {x->turned[now][0][i], x->turned[now][1][i], x->turned[now][2][i]}, y[3];
        x->offset[now][i] += dot(d, own);
        turned_back(placed->R, d, y);
        for (int r = 0; r < 3; r++) x->turned[now][r][i] = y[r];
    }
    *side = now;
    return count;
}

/* Smallest products of a direction in base with the points of one cluster of a task, without its ball, at the corners
   of a box; adds them and their corner to what is kept. */
static void keep_at_corners(Boxes *x, const BoxTask *task, const double *n, int is_second, Kept *kept) {
    const Pair *pair = &x->s.pairs[task->pair];
    const Cluster cluster = is_second ? task->b : task->a;
    const Placed *placed = &x->s.placed[cluster.tree];
    const Tree *tree = &x->s.trees[placed->tree];
    int side, count = turn_to_corners(x, task, n, is_second, &side), at = tree->first[cluster.node], best = at;
    int end = at + tree->count[cluster.node], base = base_of(x, pair), corner = 0;
    double (*d)[CORNERS] = x->turned[side], *least = x->least;
    double mean[3] = {0}, spread = 0, lowest_of_all = INFINITY, smallest = INFINITY;
    for (int i = 0; i < count; i++)
        for (int r = 0; r < 3; r++) mean[r] += d[r][i] / count;
    for (int i = 0; i < count; i++) {
        double off[3] = {d[0][i] - mean[0], d[1][i] - mean[1], d[2][i] - mean[2]};
        spread = fmax(spread, dot(off, off));
        least[i] = INFINITY;
    }
    for (int p = at; p < end; p++) {
        double height = tree->x[p] * mean[0] + tree->y[p] * mean[1] + tree->z[p] * mean[2];
        if (height < lowest_of_all) lowest_of_all = height, best = p;
    }
    for (int p = at; p < end; p++) { /* points that are not lowest at any corner are left out */
        double o[3] = {tree->x[p], tree->y[p], tree->z[p]};
        double from[3] = {o[0] - tree->x[best], o[1] - tree->y[best], o[2] - tree->z[best]}, above = dot(mean, from);
        if (p != best && above > 0 && above * above >= spread * dot(from, from)) continue;
        for (int i = 0; i < count; i++) {
            double height = d[0][i] * o[0] + d[1][i] * o[1] + d[2][i] * o[2];
            least[i] = height < least[i] ? height : least[i];
        }
    }
    for (int i = 0; i < count; i++) {
        if (placed->has_apex) least[i] = fmin(least[i], d[0][i] * placed->apex[0] + d[1][i] * placed->apex[1] + d[2][i] * placed->apex[2]);
        if (placed->disc > 0) least[i] -= placed->disc * sqrt(d[0][i] * d[0][i] + d[1][i] * d[1][i]);
        least[i] += x->offset[side][i];
        if (least[i] < smallest) smallest = least[i], corner = i;
    }
    kept->kept += smallest;
    for (int bit = 0; 1 << bit < count; bit++) {
        int j = is_second ? base - 1 - bit : base + bit;
        if (corner >> bit & 1) kept->corner |= 1 << (j - pair->m);
        for (int i = 0; i < count; i++) kept->slopes[j] += (i >> bit & 1 ? 2 : -2) * least[i] / count;
    }
}

/* Gaps of a unit direction in base at the corners of a box. */
static Kept kept_at_corners(Boxes *x, const BoxTask *task, const double *n) {
    const Placed *first = &x->s.placed[task->a.tree], *second = &x->s.placed[task->b.tree];
    double reversed[3] = {-n[0], -n[1], -n[2]};
    Kept kept = {.kept = -(first->ball + second->ball) * norm(n)};
    keep_at_corners(x, task, n, 0, &kept);
    keep_at_corners(x, task, reversed, 1, &kept);
    return kept;
}

/* The distance of a whole pair at a position of the joints; stored if it is the smallest. */
static double measure_place(Boxes *x, int pair, const double *q, int at) {
    Search *s = &x->s;
    put_at(x, 1, q);
    Task whole = {.pair = pair, .a = {s->pairs[pair].first, 0}, .b = {s->pairs[pair].second, 0}, .start = 1, .end = 1};
    double d[3], within = fmax(s->result->nearest, s->step.margin) + 1e-9;
    between_middles(s, &whole, d);
    if (ball_gap(s, &whole, 1, d) / norm(d) >= within) return within;
    double distance = measured(s, pair, 1, within, d);
    if (distance < s->result->nearest) memcpy(x->place, q, x->joints * sizeof(double));
    take_nearer(s, pair, at, distance);
    return distance;
}

/* Measure at some instants, in the middle of the tube. */
static int look_along(Boxes *x) {
    double q[BOTH];
    for (int look = 0; look < LOOKS; look++) {
        int at = (int)((int64_t)(x->tube.instants - 1) * look / (LOOKS - 1));
        for (int i = 0; i < x->joints; i++) q[i] = 0.5 * (x->tube.low[x->joints * at + i] + x->tube.high[x->joints * at + i]);
        for (int pair = 0; pair < x->s.step.pairs; pair++) {
            double distance = measure_place(x, pair, q, at);
            if (distance <= x->s.step.margin) return refuse(&x->s, pair, at, distance, TOO_NEAR);
        }
    }
    return PROVEN;
}

/* The part of a box within a tube at an instant, or the whole between neighbouring instants;
   returns whether it is not empty. */
static int allowed_at(const Boxes *x, const BoxTask *task, int at, double *low, double *high) {
    const double *lowest = x->tube.low + (size_t)x->joints * at, *highest = x->tube.high + (size_t)x->joints * at;
    int is_any = 1;
    memcpy(low, task->low, sizeof task->low);
    memcpy(high, task->high, sizeof task->high);
    for (int i = 0; i < x->joints && task->last - task->first > 1; i++) {
        low[i] = fmax(task->low[i], lowest[i]);
        high[i] = fmin(task->high[i], highest[i]);
        is_any = is_any && low[i] <= high[i];
    }
    return is_any;
}

/* A corner of a box for the joints between the frames of a pair, with the others in the middle. */
static void corner_of(const Boxes *x, const Pair *pair, int corner, const double *low, const double *high, double *q) {
    for (int i = 0; i < x->joints; i++) {
        q[i] = 0.5 * (low[i] + high[i]);
        if (i >= pair->m && i < pair->k) q[i] = corner >> (i - pair->m) & 1 ? high[i] : low[i];
    }
}

/* Whether the box brings both clusters near, and not the size of hulls compared with their content;
   measured at a position if more than `loss` depends on it. */
static int is_by_box(Boxes *x, const BoxTask *task, const double *q, double goal, double loss, const double *d) {
    Search *s = &x->s;
    if (is_leaf(s, task->a) && is_leaf(s, task->b)) return 1;
    put_at(x, 1, q);
    Task there = {.pair = task->pair, .a = task->a, .b = task->b, .start = 1, .end = 1};
    View v = view_of(s, &there);
    Found f;
    copy(d, f.d);
    separated(s, &v, goal + loss, &f);
    double within = fmax(goal, fmax(gap(s, &v, f.d, NULL) / norm(f.d), 0) + OF_CLUSTERS * loss);
    return measured_between(s, task->pair, task->a, task->b, 1, within, f.d) < within;
}

/* A letter for one task; sets *code when the search ends. */
static int letter_of_box(Boxes *x, BoxTask *task, double *conclusion, int *code) {
    Search *s = &x->s;
    const Pair *pair = &s->pairs[task->pair];
    double q[BOTH], n[3], seen[3], moved, low[BOTH], high[BOTH];
    if (x->tube.shortest && !memchr(x->is_open + task->first, 0, task->last - task->first)) return SEPARATED;
    double sag = sag_of_box(x, task, &moved), spare = s->step.spare;
    for (int i = 0; i < x->joints; i++) q[i] = 0.5 * (task->low[i] + task->high[i]);
    put_at(x, 0, q);
    Task middle = {.pair = task->pair, .a = task->a, .b = task->b};
    between_middles(s, &middle, n);
    double length = norm(n), goal = asked_of_boxes(x) + sag + spare;
    for (int i = 0; i < 3; i++) n[i] /= length;
    Kept kept = {.kept = ball_gap(s, &middle, 0, n) - moved};
    if (kept.kept <= goal) {
        View v = view_of(s, &middle);
        kept.kept = -FAR;
        if (task->has_n) turn_in_middle(x, task, 1, task->n, seen);
        if (task->has_n && gap(s, &v, seen, NULL) > goal) kept = kept_at_corners(x, task, task->n);
        if (kept.kept <= goal) {
            Found f;
            copy(task->has_n ? seen : n, f.d);
            separated(s, &v, goal + 2 * moved, &f); /* more is not needed anywhere in the box */
            length = norm(f.d);
            for (int i = 0; i < 3; i++) seen[i] = f.d[i] / length;
            turn_in_middle(x, task, 0, seen, task->n);
            task->has_n = 1;
            double apart = gap(s, &v, seen, NULL);
            int is_apart = apart > goal;
            if (is_apart) kept = kept_at_corners(x, task, task->n);
            if (kept.kept <= goal) {
                double loss = is_apart ? apart - kept.kept + sag : moved;
                if (is_apart) corner_of(x, pair, kept.corner, task->low, task->high, q);
                if (!is_by_box(x, task, q, goal, loss, seen)) {
                    double first = is_leaf(s, task->a) ? 0 : extent_of(s, task->a);
                    return first >= (is_leaf(s, task->b) ? 0 : extent_of(s, task->b)) ? BOX_CUT_FIRST : BOX_CUT_SECOND;
                }
                int cells = task->last - task->first, at = (task->first + task->last) / 2;
                if (cells <= x->tube.shortest) return memset(x->is_open + task->first, 1, cells), SEPARATED;
                if (x->tube.shortest || !allowed_at(x, task, at, low, high)) return BOX_CUT_TIME;
                corner_of(x, pair, kept.corner, low, high, q); /* measure the distance */
                double distance = measure_place(x, task->pair, q, at);
                if (distance <= s->step.margin) return *code = refuse(s, task->pair, at, distance, TOO_NEAR), NONE;
                double motion = 0, widest = -1;
                int joint = pair->m;
                for (int j = pair->m; j < pair->k; j++) {
                    double w = task->high[j] - task->low[j], still = fmax(high[j] - low[j], 0);
                    double reach = is_apart ? fabs(kept.slopes[j]) + 2 * x->sagging[j] : sqrt(8 * x->sagging[j]);
                    if (w > 0) motion += reach * (1 - still / w);
                    if (w > 0 && reach > widest) widest = reach, joint = j;
                }
                if (cells > 1 && motion >= OF_MOTION * widest) return BOX_CUT_TIME;
                if (0.5 * (task->low[joint] + task->high[joint]) <= task->low[joint])
                    return *code = refuse(s, task->pair, at, apart, NOT_SHOWN), NONE;
                return BOX_CUT_JOINT + joint;
            }
        }
    } else {
        turn_in_middle(x, task, 0, n, task->n);
    }
    *conclusion = kept.kept - sag;
    return SEPARATED;
}

/* A half of a cut task; returns whether it is not empty. */
static int half_box(const Boxes *x, const BoxTask *task, int letter, int side, BoxTask *half) {
    *half = *task;
    if (letter == BOX_CUT_FIRST) half->a = child(&x->s, task->a, side);
    if (letter == BOX_CUT_SECOND) half->b = child(&x->s, task->b, side);
    if (letter >= BOX_CUT_JOINT) {
        int j = letter - BOX_CUT_JOINT;
        double middle = 0.5 * (task->low[j] + task->high[j]);
        if (side) half->low[j] = middle; else half->high[j] = middle;
    }
    if (letter != BOX_CUT_TIME) return 1;
    double low[BOTH], high[BOTH];
    int middle = (task->first + task->last) / 2, is_any = 1;
    if (side) half->first = middle; else half->last = middle;
    hull(x, half->first, half->last, low, high);
    for (int i = 0; i < x->joints; i++) {
        half->low[i] = fmax(half->low[i], low[i]), half->high[i] = fmin(half->high[i], high[i]);
        is_any = is_any && half->low[i] <= half->high[i];
    }
    return is_any;
}

static int box_levels(Boxes *x, BoxTask *tasks, BoxTask *next, uint8_t *letters, double *directions, int64_t room) {
    Result *r = x->s.result;
    int count = x->s.step.pairs;
    if (count > MAX_BOXES) return TOO_MUCH;
    for (int i = 0; i < count; i++) {
        tasks[i] = (BoxTask){.pair = i, .last = x->tube.instants - 1, .a = {x->s.pairs[i].first, 0}, .b = {x->s.pairs[i].second, 0}};
        hull(x, 0, tasks[i].last, tasks[i].low, tasks[i].high);
    }
    int code = x->tube.shortest ? PROVEN : look_along(x);
    while (count && code == PROVEN) {
        int made = 0;
        if (r->tasks + count > room) return TOO_MUCH;
        for (int i = 0; i < count; i++) {
            double conclusion = FAR;
            int letter = letter_of_box(x, &tasks[i], &conclusion, &code);
            if (code != PROVEN) return code;
            letters[r->tasks++] = (uint8_t)letter;
            if (letter == SEPARATED) {
                copy(tasks[i].n, directions + 3 * r->directions++);
                r->proven = fmin(r->proven, conclusion);
                continue;
            }
            if (made + 2 > MAX_BOXES) return TOO_MUCH;
            for (int side = 0; side < 2; side++) made += half_box(x, &tasks[i], letter, side, &next[made]);
        }
        BoxTask *other = tasks;
        tasks = next, next = other, count = made;
    }
    return code;
}

/* Letters and directions of rows over a tube, `room` of each at most; returns PROVEN or why not. Where
   the tube says how few cells are marked, `is_open` says of each cell whether something is not
   shown to be apart there, and rows prove nothing. `place` gets the angles at which the nearest was
   met. */
int find_box_rows(const Tree *trees, const Placed *placed, const Pair *pairs, const Step *step, const Tube *tube,
                  uint8_t *letters, double *directions, int64_t room, uint8_t *is_open, double *place, Result *result) {
    Boxes *x = calloc(1, sizeof(Boxes));
    BoxTask *tasks = malloc(2 * MAX_BOXES * sizeof(BoxTask));
    int code = TOO_MUCH;
    *result = (Result){.nearest = FAR, .proven = FAR, .nearest_pair = -1, .found_pair = -1};
    if (x && tasks) {
        x->s = (Search){.trees = trees, .placed = placed, .pairs = pairs, .step = *step, .result = result};
        x->s.times = x->times, x->s.frames = x->frames[0];
        x->s.step.pieces = 0, x->s.step.duration = 1;
        number_spans(&x->s);
        x->tube = *tube, x->joints = step->joints, x->is_open = is_open, x->place = place;
        code = box_levels(x, tasks, tasks + MAX_BOXES, letters, directions, room);
    }
    free(x), free(tasks);
    return code;
}
