/* Two laminae in lane order: a block of periods with contact, ledger and record, as C.
 *
 * It does what engines/compiled/steps.py `run_plain` does for systems that are chained, without
 * pairs inside elements, pairs that touch at rest, or pairs with numbers of their own. The names
 * are those of simd_chains.py, contact.py, rules.py and complementarity.py, which explain the
 * method. tables.h is written from the classes of named tuples; both engines read one table.
 *
 *     a field of X       | row 0: u of lanes 0-3, phi of lanes 0-3 | row 1 | ... | row m - 1 |
 *     a solution tape    | row 0: -L (2x2), D^-1 (2x2), -U (2x2), each entry for four lanes | ... |
 *     a form tape        | row 0: D00, D01 + D10, D11, coupling (2x2), each for four lanes | ... |
 *     u of a slot        | step 0: m.u, c.u, k.u, probes | step 1 | ... | step N |
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include "tables.h"

typedef double v4 __attribute__((vector_size(32)));
typedef int64_t l4 __attribute__((vector_size(32)));
enum { U, V, A, Y, Z, R, P };                                  /* fields of X */
enum { S, KAPPA, TO_U, MINUS_RHO };                            /* rows of the coefficients */
enum { NONE, IMPACTS, PENALTY, MOREAU };                       /* kinds of laws */
enum { DISSIPATED, CONTACT_DAMPED, IMPACT, RELEASED };         /* of totals */
enum { N_SPRINGS, N_EVENTS, N_HITS, N_FRAMES, N_RESTING, IS_SEEN, SLOT, OLD_EVENTS, OLD_HITS };
enum { COMPLETED, DIVERGED, FULL };
enum { SOLVED, NOT_FINITE, NOT_FOUND, OUT_OF_RANGE };
enum { IDLE, ACTIVE, BARRED };
enum { OPEN, HIT, RESTING };
static const double RELATIVE_RESIDUAL = 1e-14, TOLERANCE = 1e-13, SINGULAR = 1e-13, LIFT = 1e-9;
static const double GONE = 1e-14, UNSOLVABLE = 1e-4;

static inline v4 load(const double *p) { v4 x; memcpy(&x, p, sizeof x); return x; }
static inline void store(double *p, v4 x) { memcpy(p, &x, sizeof x); }
static inline v4 splat(double x) { return (v4){x, x, x, x}; }
static inline v4 swap_neighbours(v4 x) { return __builtin_shuffle(x, (l4){1, 0, 3, 2}); }
static inline v4 swap_halves(v4 x) { return __builtin_shuffle(x, (l4){2, 3, 0, 1}); }

/* Where a is not a number, b. */
static inline v4 smaller(v4 a, v4 b) {
#ifdef __AVX__
    return __builtin_ia32_minpd256(a, b);
#endif
    const l4 is_less = a < b;
    return (v4)((is_less & (l4)a) | (~is_less & (l4)b));
}


/* a b + c, rounded once where the processor can: a compiler may fuse another product, which makes chains longer. */
static inline v4 fused(v4 a, v4 b, v4 c) {
#ifdef __FMA__
    return __builtin_ia32_vfmaddpd256(a, b, c);
#endif
    return a * b + c;
}

static inline double total(v4 a) { return (a[0] + a[1]) + (a[2] + a[3]); }
static inline double lesser(double a, double b) { return b < a ? b : a; }
static inline double greater(double a, double b) { return b > a ? b : a; }

static inline double least_lane(v4 gap) {
    gap = smaller(gap, swap_neighbours(gap));
    return smaller(gap, swap_halves(gap))[0];
}

/* y_j = r_j - L_j y_{j-1} */
static inline void forth(const double *t, v4 *r0, v4 *r1, v4 y0, v4 y1) {
    *r0 = fused(load(t + 4), y1, fused(load(t), y0, *r0));
    *r1 = fused(load(t + 12), y1, fused(load(t + 8), y0, *r1));
}

/* x_j = D_j^-1 y_j - U_j x_{j+1} */
static inline void back(const double *t, v4 y0, v4 y1, v4 *x0, v4 *x1) {
    v4 own0 = load(t) * y0 + load(t + 4) * y1;
    v4 own1 = load(t + 8) * y0 + load(t + 12) * y1;
    own0 = fused(load(t + 16), *x0, own0);
    own1 = fused(load(t + 24), *x0, own1);
    *x0 = fused(load(t + 20), *x1, own0);
    *x1 = fused(load(t + 28), *x1, own1);
}

/* The part of a row in z^T C z. */
static inline v4 flow(const double *q, v4 z0, v4 z1, v4 z0_next, v4 z1_next) {
    v4 f0 = load(q) * z0 + load(q + 4) * z1 + load(q + 12) * z0_next + load(q + 16) * z1_next;
    v4 f1 = load(q + 8) * z1 + load(q + 20) * z0_next + load(q + 24) * z1_next;
    return z0 * f0 + z1 * f1;
}

/* Forward substitution with r = dt f + B w for a diagonal B. */
static inline void eliminate_diagonal(const System *s, double *restrict X, v4 f0, v4 f1) {
    const int64_t size = s->size;
    const double *restrict tape = s->forth;
    const double *restrict u = X, *restrict v = X + V * size;
    double *restrict y = X + Y * size;
    const v4 c = load(s->coefficients + 4 * S);
    v4 y0 = f0 + load(tape) * (load(u) + c * load(v));
    v4 y1 = f1 + load(tape + 4) * (load(u + 4) + c * load(v + 4));
    store(y, y0);
    store(y + 4, y1);
    for (int64_t i = 8; i < size; i += 8) {
        const double *b = tape + 3 * i;
        v4 r0 = load(b) * (load(u + i) + c * load(v + i));
        v4 r1 = load(b + 4) * (load(u + i + 4) + c * load(v + i + 4));
        forth(b + 8, &r0, &r1, y0, y1);
        y0 = r0;
        y1 = r1;
        store(y + i, y0);
        store(y + i + 4, y1);
    }
}

/* The same for a block tridiagonal B; behind the last row comes itself with its lanes swapped. */
static inline void eliminate_chained(const System *s, double *restrict X, v4 r0, v4 r1) {
    const int64_t size = s->size;
    const double *restrict tape = s->forth;
    const double *restrict u = X, *restrict v = X + V * size;
    double *restrict y = X + Y * size;
    const v4 c = load(s->coefficients + 4 * S);
    v4 y0 = splat(0.0), y1 = y0, before0 = y0, before1 = y0, next0, next1;
    v4 w0 = load(u) + c * load(v), w1 = load(u + 4) + c * load(v + 4);
    for (int64_t i = 0; i < size; i += 8) {
        const int64_t j = i + 8;
        if (j < size) {
            next0 = load(u + j) + c * load(v + j);
            next1 = load(u + j + 4) + c * load(v + j + 4);
        } else {
            next0 = swap_neighbours(w0);
            next1 = swap_neighbours(w1);
        }
        const double *b = tape + 8 * i;
        r0 = load(b) * before0 + r0;
        r1 = load(b + 8) * before0 + r1;
        r0 = load(b + 4) * before1 + r0;
        r1 = load(b + 12) * before1 + r1;
        r0 = load(b + 16) * w0 + r0;
        r1 = load(b + 24) * w0 + r1;
        r0 = load(b + 20) * w1 + r0;
        r1 = load(b + 28) * w1 + r1;
        r0 = load(b + 32) * next0 + r0;
        r1 = load(b + 40) * next0 + r1;
        r0 = load(b + 36) * next1 + r0;
        r1 = load(b + 44) * next1 + r1;
        forth(b + 48, &r0, &r1, y0, y1);
        y0 = r0;
        y1 = r1;
        store(y + i, y0);
        store(y + i + 4, y1);
        before0 = w0;
        before1 = w1;
        w0 = next0;
        w1 = next1;
        r0 = r1 = splat(0.0);
    }
}

/* Backward substitution, the new state (L1, L2), z^T C z and the smallest gap. */
static inline double finish(const System *s, double *restrict X, int64_t held, int keeps, double *smallest) {
    const int64_t size = s->size, last = size - 8;
    const double *restrict t = s->back;
    const double *c = s->coefficients;
    const v4 kappa = load(c + 4 * KAPPA), to_u = load(c + 4 * TO_U), minus_rho = load(c + 4 * MINUS_RHO);
    double *restrict u = X, *restrict v = X + V * size;
    const double *restrict y = X + Y * size;
    v4 x0 = swap_neighbours(load(y + last)), x1 = swap_neighbours(load(y + last + 4));
    v4 z0_next = splat(0.0), z1_next = z0_next, loss0 = z0_next, loss1 = z0_next, gap = splat(INFINITY);
    for (int64_t i = last; i >= 0; i -= 8, t += 64) {
        back(t, load(y + i), load(y + i + 4), &x0, &x1);
        v4 v0 = load(v + i), v1 = load(v + i + 4), u0 = load(u + i), u1 = load(u + i + 4);
        v4 z0 = x0 + kappa * (held == U ? u0 : v0), z1 = x1 + kappa * (held == U ? u1 : v1);
        u0 += to_u * z0;
        u1 += to_u * z1;
        store(u + i, u0);
        store(u + i + 4, u1);
        store(v + i, z0 + minus_rho * v0);
        store(v + i + 4, z1 + minus_rho * v1);
        if (keeps) {
            store(X + P * size + i, z0);
            store(X + P * size + i + 4, z1);
        }
        if (i == last) {
            z0_next = swap_neighbours(z0);
            z1_next = swap_neighbours(z1);
        }
        const double *q = t + 32;
        loss0 += z0 * (load(q) * z0 + load(q + 4) * z1 + load(q + 12) * z0_next + load(q + 16) * z1_next);
        loss1 += z1 * (load(q + 8) * z1 + load(q + 20) * z0_next + load(q + 24) * z1_next);
        z0_next = z0;
        z1_next = z1;
        gap = smaller(swap_halves(u0) - u0 + load(t + 60), gap);
    }
    *smallest = least_lane(gap);
    return total(loss0 + loss1);
}

static inline double step(const System *s, double *restrict X, const double *q, int keeps, double *smallest) {
    const int64_t size = s->size;
    const double *base = s->base;
    const v4 by_q = splat(-s->scheme.time_step * q[0]), by_dq = splat(-s->scheme.time_step * q[1]);
    const v4 by_ddq = splat(-s->scheme.time_step * q[2]);
    v4 f0 = by_q * load(base + 2 * size) + by_dq * load(base + size) + by_ddq * load(base);
    v4 f1 = by_q * load(base + 2 * size + 4) + by_dq * load(base + size + 4) + by_ddq * load(base + 4);
    if (s->is_diagonal_load) {
        eliminate_diagonal(s, X, f0, f1);
        return finish(s, X, U, keeps, smallest);
    }
    eliminate_chained(s, X, f0, f1);
    return finish(s, X, V, keeps, smallest);
}

static double loss_of(const System *s, const double *X) {
    const int64_t last = s->size - 8;
    const double *z = X + P * s->size;
    v4 z0_next = swap_neighbours(load(z + last)), z1_next = swap_neighbours(load(z + last + 4));
    v4 loss = splat(0.0);
    for (int64_t i = last; i >= 0; i -= 8) {
        v4 z0 = load(z + i), z1 = load(z + i + 4);
        loss += flow(s->form + i / 2 * 7, z0, z1, z0_next, z1_next);
        z0_next = z0;
        z1_next = z1;
    }
    return total(loss);
}

static inline double smallest_gap(const System *s, const double *X, double ahead) {
    v4 gap = splat(INFINITY);
    for (int64_t i = 0; i < s->size; i += 8) {
        v4 u = load(X + i) + splat(ahead) * load(X + s->size + i);
        gap = smaller(swap_halves(u) - u + load(s->rest + i / 2), gap);
    }
    return least_lane(gap);
}

static void substitute(double *X, int64_t size, const double *t) {
    const double *r = X + R * size;
    double *x = X + Z * size;
    v4 y0 = load(r), y1 = load(r + 4);
    store(x, y0);
    store(x + 4, y1);
    for (int64_t i = 8; i < size; i += 8) {
        v4 r0 = load(r + i), r1 = load(r + i + 4);
        forth(t + 6 * i, &r0, &r1, y0, y1);
        y0 = r0;
        y1 = r1;
        store(x + i, y0);
        store(x + i + 4, y1);
    }
    y0 = swap_neighbours(y0);
    y1 = swap_neighbours(y1);
    for (int64_t i = size - 8; i >= 0; i -= 8) {
        back(t + 6 * i + 16, load(x + i), load(x + i + 4), &y0, &y1);
        store(x + i, y0);
        store(x + i + 4, y1);
    }
}

static inline double row_product(const Rows *m, int64_t row, const double *x) {
    double result = 0.0;
    for (int64_t e = m->start[row]; e < m->start[row + 1]; e++) result += m->value[e] * x[m->column[e]];
    return result;
}

static inline void spread_one(const System *s, double *X, int64_t pair, double value) {
    const Rows *h = &s->gap_rows;
    for (int64_t e = h->start[pair]; e < h->start[pair + 1]; e++)
        X[R * s->size + h->column[e]] += value * h->value[e];
}

/* Write sign H^T p into r; springs act on gaps times the roots of their weights. */
static void spread(const System *s, double *X, const int64_t *pairs, const double *p, int64_t n, double sign, const double *roots) {
    memset(X + R * s->size, 0, s->size * sizeof *X);
    for (int64_t k = 0; k < n; k++) spread_one(s, X, pairs[k], sign * (roots ? roots[pairs[k]] : 1.0) * p[k]);
}

/* -- springs (newmark.py, N2) ---------------------------------------------------------------- */

static double spring_energy(const System *s, const LawNumbers *law, const Memory *m) {
    double sum = 0.0;
    for (int64_t j = 0; law->stiffness != 0.0 && j < m->counts[N_SPRINGS]; j++) {
        const int64_t k = m->pairs[j];
        const double gap = s->roots[k] * (s->gap0[k] + row_product(&s->gap_rows, k, m->X));
        sum += gap * gap;
    }
    return 0.5 * law->stiffness * sum;
}

static void push_springs(const System *s, const LawNumbers *law, Memory *m) {
    const int64_t n = m->counts[N_SPRINGS], size = s->size;
    const StepNumbers *d = &s->scheme;
    const double softness = law->stiffness * d->q + law->damping * d->p;
    const double by_rate = law->damping * d->theta - law->stiffness * d->p * (1.0 - d->theta);
    double *X = m->X, *residual = m->residual, *forces = m->forces, *direction = m->direction, square = 0.0;
    for (int64_t j = 0; j < n; j++) {
        const int64_t k = m->pairs[j];
        const double gap = s->gap0[k] + row_product(&s->gap_rows, k, X);
        residual[j] = law->stiffness * (s->roots[k] * gap);
        if (by_rate != 0.0) residual[j] += by_rate * s->roots[k] * row_product(&s->gap_rows, k, X + P * size);
        square += residual[j] * residual[j];
        direction[j] = residual[j];
        forces[j] = softness == 0.0 ? residual[j] : 0.0;
    }
    const double goal = RELATIVE_RESIDUAL * RELATIVE_RESIDUAL * square;
    for (int64_t i = 0; i < 2 * n && softness != 0.0 && square > goal; i++) {
        double curvature = 0.0;
        spread(s, X, m->pairs, direction, n, 1.0, s->roots);
        substitute(X, size, s->solution);
        for (int64_t j = 0; j < n; j++) {
            const int64_t k = m->pairs[j];
            m->image[j] = direction[j] + softness * s->roots[k] * row_product(&s->gap_rows, k, X + Z * size);
            curvature += direction[j] * m->image[j];
        }
        const double length = square / curvature, previous = square;
        square = 0.0;
        for (int64_t j = 0; j < n; j++) {
            forces[j] += length * direction[j];
            residual[j] -= length * m->image[j];
            square += residual[j] * residual[j];
        }
        for (int64_t j = 0; j < n; j++) direction[j] = residual[j] + square / previous * direction[j];
    }
    spread(s, X, m->pairs, forces, n, -1.0, s->roots);
    substitute(X, size, s->solution);
    for (int64_t i = 0; i < size; i++) {
        const double z = X[Z * size + i];
        X[i] += d->time_step * d->p * z;
        X[size + i] += d->time_step * z;
        X[A * size + i] += z;
        X[P * size + i] += d->time_step * z;
    }
}

static void list_springs(const System *s, Memory *m) {
    int64_t n = 0;
    for (int64_t k = 0; k < s->n_pairs; k++)
        if (m->pair_state.resting[k]) m->pairs[n++] = k;
    m->counts[N_SPRINGS] = n;
}

/* -- complementarity (Lawson and Hanson) ------------------------------------------------------ */

typedef struct {
    const double *W, *q;
    const int64_t *pairs;
    double *p, *change;
    int64_t origin, stride, n;
    WarmStart *memory;
} Impulses;

static double compliance(const Impulses *c, int64_t i, int64_t j) {
    return c->W[c->origin + c->pairs[j] * c->stride + c->pairs[i]];
}

static int factorise(const Impulses *c, int64_t m, double lift) {
    WarmStart *w = c->memory;
    int64_t n_kept = 0;
    if (w->members[1] == c->origin)
        while (n_kept < m && n_kept < w->members[0] && w->members[2 + n_kept] == c->pairs[w->active[n_kept]]) n_kept++;
    w->members[0] = n_kept;
    w->members[1] = c->origin;
    for (int64_t i = n_kept; i < m; i++) {
        double *row = w->factor + i * c->stride;
        for (int64_t j = 0; j <= i; j++) {
            const double *other = w->factor + j * c->stride;
            double value = compliance(c, w->active[i], w->active[j]);
            if (j == i) value += lift * value;
            for (int64_t k = 0; k < j; k++) value -= row[k] * other[k];
            if (j < i) row[j] = value * other[j];
            else if (value > SINGULAR * compliance(c, w->active[i], w->active[i])) row[i] = 1.0 / sqrt(value);
            else return 0;
        }
        w->members[2 + i] = c->pairs[w->active[i]];
        w->members[0] = i + 1;
    }
    return 1;
}

/* Move p towards the solution of W_AA s = -q_A while all stay >= 0; m becomes the number still active. */
static int move(const Impulses *c, int64_t *m) {
    WarmStart *w = c->memory;
    const double *factor = w->factor;
    double *trial = w->trial, step = 1.0;
    int64_t n_active = 0;
    for (int64_t i = 0; i < *m; i++) {
        double value = -c->q[w->active[i]];
        for (int64_t k = 0; k < i; k++) value -= factor[i * c->stride + k] * trial[k];
        trial[i] = value * factor[i * c->stride + i];
    }
    for (int64_t i = *m - 1; i >= 0; i--) {
        const double value = trial[i] *= factor[i * c->stride + i];
        for (int64_t k = 0; k < i; k++) trial[k] -= factor[i * c->stride + k] * value;
    }
    for (int64_t i = 0; i < *m; i++)
        if (trial[i] <= 0.0) {
            const double before = c->p[w->active[i]];
            step = before > trial[i] ? lesser(step, before / (before - trial[i])) : 0.0;
        }
    for (int64_t i = 0; i < *m; i++) {
        const int64_t j = w->active[i];
        c->p[j] = step == 1.0 ? trial[i] : c->p[j] + step * (trial[i] - c->p[j]);
        if (step < 1.0 && trial[i] <= 0.0 && c->p[j] <= GONE * fabs(trial[i])) {
            c->p[j] = 0.0;
            w->side[j] = IDLE;
        } else {
            w->active[n_active++] = j;
        }
    }
    *m = n_active;
    return step == 1.0;
}

static int64_t list_active(const Impulses *c) {
    int64_t m = 0;
    for (int64_t j = 0; j < c->n; j++)
        if (c->memory->side[j] == ACTIVE) c->memory->active[m++] = j;
    return m;
}

/* Compute the impulses of the active pairs in their order, on which alone they depend then. */
static void put_in_order(const Impulses *c, int64_t m, double lift) {
    WarmStart *w = c->memory;
    int is_in_order = 1;
    for (int64_t i = 1; i < m; i++) is_in_order &= w->active[i - 1] < w->active[i];
    if (is_in_order) return;
    list_active(c);
    if (!factorise(c, m, lift)) return;
    for (int64_t i = 0; i < m; i++) c->p[w->active[i]] = 0.0;
    move(c, &m);
}

static int64_t most_violated(const Impulses *c, int64_t m, double limit) {
    const WarmStart *w = c->memory;
    double best = -limit;
    int64_t chosen = -1;
    for (int64_t j = 0; j < c->n; j++) {
        if (w->side[j] != IDLE) continue;
        double residual = c->q[j];
        for (int64_t i = 0; i < m; i++) residual += compliance(c, j, w->active[i]) * c->p[w->active[i]];
        if (residual < best) {
            best = residual;
            chosen = j;
        }
    }
    return chosen;
}

static int is_found(const Impulses *c, double limit, double lift) {
    WarmStart *w = c->memory;
    for (int64_t j = 0; j < c->n; j++) {
        c->p[j] = 0.0;
        w->side[j] = w->was_idle[c->pairs[j]] ? IDLE : ACTIVE;
    }
    int64_t m = list_active(c);
    int is_fresh = m == 0;
    for (int64_t round = 0; round < 4 * c->n + 20; round++) {
        if (factorise(c, m, lift)) {
            if (!move(c, &m)) continue;
            for (int64_t j = 0; j < c->n; j++) w->side[j] = w->side[j] == ACTIVE ? ACTIVE : IDLE;
        } else if (is_fresh) {
            w->side[w->active[--m]] = BARRED;
        } else {
            is_fresh = 1;
            m = 0;
            for (int64_t j = 0; j < c->n; j++) {
                c->p[j] = 0.0;
                w->side[j] = IDLE;
            }
        }
        const int64_t chosen = most_violated(c, m, limit);
        if (chosen < 0) {
            put_in_order(c, m, lift);
            return 1;
        }
        w->side[chosen] = ACTIVE;
        w->active[m++] = chosen;
    }
    return 0;
}

static int attempt(const Impulses *c, double largest, double lift) {
    int result = is_found(c, TOLERANCE * largest, lift) ? SOLVED : NOT_FOUND;
    for (int64_t i = 0; i < c->n; i++) {
        c->change[i] = 0.0;
        for (int64_t j = 0; j < c->n; j++) c->change[i] += compliance(c, i, j) * c->p[j];
        if (!(c->change[i] + c->q[i] >= -UNSOLVABLE * largest) && result == SOLVED) result = OUT_OF_RANGE;
    }
    return result;
}

static int solve_among(const Impulses *c) {
    double largest = 0.0;
    for (int64_t j = 0; j < c->n; j++) {
        if (!isfinite(c->q[j])) return NOT_FINITE;
        largest = greater(largest, fabs(c->q[j]));
    }
    if (c->n == 1) {
        const double single = compliance(c, 0, 0);
        c->p[0] = greater(0.0, -c->q[0] / single);
        c->change[0] = single * c->p[0];
        return isfinite(single) ? SOLVED : NOT_FINITE;
    }
    int result = attempt(c, largest, 0.0);
    if (result != SOLVED) {
        c->memory->members[0] = -1;
        result = attempt(c, largest, LIFT);
        c->memory->members[0] = -1;
    }
    for (int64_t j = 0; j < c->n && result == SOLVED; j++) c->memory->was_idle[c->pairs[j]] = c->p[j] == 0.0;
    return result;
}

/* -- the law at the end of a step (contact.py `examine`, rules.py) --------------------------- */

static void require_compliance(const System *s, const LawNumbers *law, Memory *m, int64_t pair) {
    const int64_t n = s->n_pairs, first = (s->coarseness * n + pair) * n;
    const Rows *h = &s->gap_rows;
    if (m->is_known[s->coarseness * n + pair]) return;
    m->is_known[s->coarseness * n + pair] = 1;
    if (!law->is_coupled) {
        double single = 0.0;
        for (int64_t e = h->start[pair]; e < h->start[pair + 1]; e++)
            single += h->value[e] * h->value[e] * s->inverse_lumped[h->column[e]];
        m->compliance[first + pair] = single;
        return;
    }
    memset(m->X + R * s->size, 0, s->size * sizeof *m->X);
    spread_one(s, m->X, pair, 1.0);
    substitute(m->X, s->size, law->kind == MOREAU ? s->solution : s->mass_solution);
    for (int64_t i = 0; i < n; i++) m->compliance[first + i] = row_product(h, i, m->X + Z * s->size);
}

/* Find the impulses of n candidates; return how many pairs are hit. */
static int64_t solve_impulses(const System *s, const LawNumbers *law, Memory *m, int64_t n, int *result) {
    int64_t n_hit = 0;
    const Impulses c = {m->compliance, m->residual, m->hits.pair, m->hits.impulse, m->hits.change,
                        s->coarseness * s->n_pairs * s->n_pairs, s->n_pairs, n, &m->again};
    for (int64_t j = 0; j < n; j++) require_compliance(s, law, m, m->hits.pair[j]);
    m->again.members[0] = -1;
    for (int64_t j = 0; j < n; j++) m->again.was_idle[m->hits.pair[j]] = law->kind == MOREAU;
    *result = law->is_coupled ? solve_among(&c) : SOLVED;
    for (int64_t j = 0; j < n; j++) {
        double impulse = m->hits.impulse[j], after = m->hits.rate_post[j] + m->hits.change[j];
        if (!law->is_coupled) {
            impulse = -(1.0 + law->restitution) * m->hits.rate_pre[j] / compliance(&c, j, j);
            after = -law->restitution * m->hits.rate_pre[j];
        }
        if (law->kind == MOREAU && law->is_coupled && !(impulse > 0.0)) continue;
        m->hits.pair[n_hit] = m->hits.pair[j];
        m->hits.impulse[n_hit] = impulse;
        m->hits.rate_pre[n_hit] = m->hits.rate_pre[j];
        m->hits.rate_post[n_hit++] = after;
    }
    return n_hit;
}

/* Change the velocities, or the step, by the impulses of n pairs; note them. */
static void push(const System *s, const LawNumbers *law, Memory *m, PeriodBuffers *log, int64_t n, int64_t tick) {
    const int64_t size = s->size, event = m->counts[N_EVENTS]++, first = m->counts[N_HITS];
    double *X = m->X, *restrict z = X + Z * size, *restrict r = X + R * size, *restrict v = X + size;
    const double *restrict inverse = s->inverse_lumped;
    double energy = 0.0;
    spread(s, X, m->hits.pair, m->hits.impulse, n, 1.0, NULL);
    if (law->kind == MOREAU) substitute(X, size, s->solution);
    else if (law->is_coupled) substitute(X, size, s->mass_solution);
    else for (int64_t i = 0; i < size; i++) z[i] = inverse[i] * r[i];
    if (law->kind == MOREAU) {
        const double p = s->scheme.p;
        double *restrict u = X, *restrict kept = X + P * size;
        for (int64_t i = 0; i < size; i++) {
            u[i] += p * z[i];
            kept[i] += z[i];
            v[i] += z[i];
        }
    } else {
        for (int64_t i = 0; i < size; i++) r[i] = v[i] + 0.5 * z[i];
        for (int64_t i = 0; i < size; i++)
            if (z[i] != 0.0) {
                energy += z[i] * row_product(&s->mass, i, r);
                v[i] += z[i];
            }
    }
    for (int64_t j = 0; j < n; j++) {
        if (law->kind == MOREAU) energy += m->hits.impulse[j] * 0.5 * (m->hits.rate_pre[j] + m->hits.rate_post[j]);
        log->hit[first + j] = m->hits.pair[j];
        log->impulse[first + j] = m->hits.impulse[j];
        log->rate_pre[first + j] = m->hits.rate_pre[j];
        log->rate_post[first + j] = m->hits.rate_post[j];
    }
    log->event_tick[event] = tick;
    log->event_size[event] = n;
    log->event_energy[event] = energy;
    m->counts[N_HITS] = first + n;
    m->totals[IMPACT] += energy;
}

static int examine(const System *s, const LawNumbers *law, Memory *m, PeriodBuffers *log, int64_t tick) {
    const int64_t size = s->size, kind = law->kind;
    double *gap = m->gap;
    int64_t n = 0;
    int lacks = 0, changes = 0, result = SOLVED;
    if (kind == NONE) return COMPLETED;
    for (int64_t k = 0; k < s->n_pairs; k++) {
        if (kind != MOREAU) gap[k] = s->gap0[k] + row_product(&s->gap_rows, k, m->X);
        const int is_closed = gap[k] <= 0.0, rests = m->pair_state.resting[k];
        if (kind == PENALTY) changes |= is_closed != rests;
        else if (kind == IMPACTS && !is_closed) changes |= rests;
        else if (is_closed && !(kind == IMPACTS && rests)) {
            const double free = row_product(&s->gap_rows, k, m->X + size);
            const double rate = kind == MOREAU ? m->rate[k] : free;
            if (kind == IMPACTS && !(rate < 0.0)) continue;
            m->hits.pair[n] = k;
            m->hits.rate_pre[n] = rate;
            m->hits.rate_post[n] = free;
            m->residual[n] = free + law->restitution * rate;
            lacks |= !(m->residual[n++] >= 0.0);
        }
    }
    n = lacks ? n : 0;
    if (n == 0 && !changes) return COMPLETED;
    if (n) n = solve_impulses(s, law, m, n, &result);
    if (result != SOLVED) return -result;
    if (n) push(s, law, m, log, n, tick);
    int is_changed = 0;
    for (int64_t k = 0; k < s->n_pairs; k++) {
        const int rests = kind != MOREAU && gap[k] <= 0.0 && (kind == PENALTY || m->pair_state.resting[k]);
        is_changed |= rests != m->pair_state.resting[k];
        m->pair_state.resting[k] = rests;
    }
    for (int64_t j = 0; j < n; j++)
        if (kind == MOREAU ? m->hits.rate_pre[j] > -law->threshold : m->hits.rate_post[j] < law->threshold)
            m->pair_state.resting[m->hits.pair[j]] = is_changed = 1;
    if (is_changed && kind == MOREAU) m->counts[N_RESTING] = 1;
    else if (is_changed) {
        m->totals[RELEASED] -= spring_energy(s, law, m);
        list_springs(s, m);
        m->totals[RELEASED] += spring_energy(s, law, m);
    }
    return COMPLETED;
}

/* -- steps and periods (steps.py) ------------------------------------------------------------- */

static inline void base_rows(const System *s, const double *X, double *out) {
    for (int j = 0; j < 3; j++)
        out[j] = total(load(s->base + j * s->size) * load(X) + load(s->base + j * s->size + 4) * load(X + 4));
}

static inline void observe(const System *s, const Memory *m, PeriodBuffers *log, int64_t step) {
    const int64_t row = m->counts[SLOT] * (log->n_steps + 1) + step, n = s->n_probes;
    double *u = log->u + row * (3 + n), *v = log->v + row * n;
    base_rows(s, m->X, u);
    for (int64_t k = 0; k < n; k++) {
        const double *x = m->X;
        u[3 + k] = s->is_selecting ? x[s->selected[k]] : row_product(&s->probe_rows, k, x);
        v[k] = s->is_selecting ? x[s->size + s->selected[k]] : row_product(&s->probe_rows, k, x + s->size);
        u[3 + k] += s->probe_shift[k] * m->base[0];
        v[k] += s->probe_shift[k] * m->base[1];
    }
}

static inline int make_step(const Problem *p, PeriodBuffers *log, int64_t k) {
    const System *s = &p->fine;
    const LawNumbers *law = &p->law;
    Memory *m = (Memory *)&p->memory;
    const double *new_base = log->base_states + 3 * k, after = s->scheme.theta;
    double predicted = INFINITY, smallest, mixed[3], lost;
    if (m->counts[N_RESTING]) {
        m->counts[N_RESTING] = 0;
        memset(m->pair_state.resting, 0, s->n_pairs);
    }
    if (law->kind == MOREAU) {
        predicted = smallest_gap(s, m->X, s->scheme.gap_ahead);
        for (int64_t j = 0; predicted <= 0.0 && j < s->n_pairs; j++) {
            m->rate[j] = row_product(&s->gap_rows, j, m->X + s->size);
            m->gap[j] = s->gap0[j] + row_product(&s->gap_rows, j, m->X) + s->scheme.gap_ahead * m->rate[j];
        }
    }
    for (int j = 0; j < 3; j++) {
        mixed[j] = after * new_base[j] + (1.0 - after) * m->base[j];
        m->base[j] = new_base[j];
    }
    lost = step(s, m->X, mixed, predicted <= 0.0 || m->counts[N_SPRINGS] > 0, &smallest);
    if (m->counts[N_SPRINGS]) {
        push_springs(s, law, m);
        lost = loss_of(s, m->X);
        smallest = smallest_gap(s, m->X, 0.0);
    } else if (law->kind == MOREAU) smallest = predicted;
    if (smallest < -log->limit) return DIVERGED;
    for (int64_t j = 0; law->damping != 0.0 && j < m->counts[N_SPRINGS]; j++) {
        const double rate = s->roots[m->pairs[j]] * row_product(&s->gap_rows, m->pairs[j], m->X + P * s->size);
        const double damped = s->scheme.weight * law->damping * rate * rate;
        m->totals[CONTACT_DAMPED] += damped;
        log->damped[m->counts[SLOT] * s->n_pairs + m->pairs[j]] += damped;
    }
    int status = COMPLETED;
    if (smallest <= 0.0 || m->counts[N_SPRINGS] > 0) {
        status = examine(s, law, m, log, k);
        if (law->kind == MOREAU) lost = loss_of(s, m->X);
    }
    m->totals[DISSIPATED] += s->scheme.weight * lost;
    return status;
}

static void keep_frame(const System *s, Memory *m, PeriodBuffers *log, int64_t step) {
    const int64_t n = m->counts[SLOT] * log->n_frames + m->counts[N_FRAMES]++;
    int8_t *contact = log->contact + n * s->n_pairs;
    int64_t last = m->counts[N_HITS];
    memcpy(log->frames + 2 * n * s->size, m->X, 2 * s->size * sizeof *m->X);
    for (int64_t k = 0; k < s->n_pairs; k++) contact[k] = m->pair_state.resting[k] ? RESTING : OPEN;
    for (int64_t e = m->counts[N_EVENTS] - 1; e >= m->counts[OLD_EVENTS] && log->event_tick[e] > step - 1; e--) {
        for (int64_t j = last - log->event_size[e]; j < last; j++)
            if (!m->pair_state.resting[log->hit[j]]) contact[log->hit[j]] = HIT;
        last -= log->event_size[e];
    }
}

static double form_of(const Rows *m, int64_t n, const double *x) {
    double result = 0.0;
    for (int64_t i = 0; i < n; i++) result += x[i] * row_product(m, i, x);
    return result;
}

static void store_level(const Problem *p, PeriodBuffers *log, int64_t j) {
    const System *s = &p->fine;
    const Memory *m = &p->memory;
    const double *X = m->X, q = m->base[0], dq = m->base[1];
    double *level = log->levels + 6 * j, momentum = 0.0, attachment = 0.0;
    for (int64_t i = 0; i < s->size; i++) {
        momentum += s->base[i] * X[s->size + i];
        attachment += s->base[2 * s->size + i] * X[i];
    }
    level[0] = 0.5 * form_of(&s->mass, s->size, X + s->size) + dq * momentum + 0.5 * p->corner[0] * dq * dq;
    level[1] = 0.5 * form_of(&s->stiffness, s->size, X) + q * attachment + 0.5 * p->corner[2] * q * q;
    level[2] = spring_energy(s, &p->law, m);
    level[3] = momentum;
    level[4] = m->totals[DISSIPATED];
    level[5] = m->totals[CONTACT_DAMPED];
}

static void begin_period(const Problem *p, PeriodBuffers *log, int64_t j) {
    Memory *m = (Memory *)&p->memory;
    const int64_t n_u = 3 + p->fine.n_probes, n_v = p->fine.n_probes, n_rows = log->n_steps + 1;
    const int64_t slot = j % log->n_slots, n_pairs = p->fine.n_pairs;
    m->counts[SLOT] = slot;
    m->counts[N_FRAMES] = m->counts[IS_SEEN] = 0;
    m->counts[OLD_EVENTS] = m->counts[N_EVENTS];
    m->counts[OLD_HITS] = m->counts[N_HITS];
    if (j == 0) {
        store_level(p, log, 0);
        observe(&p->fine, m, log, 0);
    } else {
        const int64_t last = ((j - 1) % log->n_slots + 1) * n_rows - 1;
        memmove(log->u + slot * n_rows * n_u, log->u + last * n_u, n_u * sizeof(double));
        memmove(log->v + slot * n_rows * n_v, log->v + last * n_v, n_v * sizeof(double));
    }
    m->totals[IMPACT] = m->totals[RELEASED] = 0.0;
    memset(m->flows, 0, 4 * sizeof(double));
    memset(m->effort, 0, 5 * sizeof(int64_t));
    memcpy(m->base, log->base_states, 3 * sizeof(double));
    memcpy(log->resting + slot * n_pairs, m->pair_state.resting, n_pairs);
    memset(log->damped + slot * n_pairs, 0, n_pairs * sizeof(double));
}

/* The row of the energy ledger (E1 to E3) of n steps. */
static void write_ledger(const Problem *p, const PeriodBuffers *log, int64_t j, int64_t n, const double *u, double *row) {
    const int64_t width = 3 + p->fine.n_probes;
    const double *start = log->levels + 6 * j, *end = start + 6, *corner = log->coupling, *q = log->base_states;
    const double *q_end = q + 3 * n, *u_end = u + n * width;
    double sums[4] = {0.0, 0.0, 0.0, 0.0};
    for (int64_t k = 1; k <= n; k++) {
        const double *a = u + (k - 1) * width, *b = a + width, *qa = q + 3 * (k - 1), *qb = qa + 3;
        const double mean = 0.5 * (qb[1] + qa[1]);
        sums[0] += (b[0] - a[0]) * 0.5 * (qb[2] + qa[2]);
        sums[1] += (b[1] - a[1]) * mean;
        sums[2] += 0.5 * (b[2] + a[2]) * (qb[0] - qa[0]);
        sums[3] += mean * mean;
    }
    const double corner_damping = corner[1] * log->time_step * sums[3];
    double work = sums[1] - sums[0] + sums[2] + end[3] * q_end[1] - start[3] * q[1]
        + 0.5 * corner[0] * (q_end[1] * q_end[1] - q[1] * q[1])
        + 0.5 * corner[2] * (q_end[0] * q_end[0] - q[0] * q[0]) + corner_damping;
    const double damping = end[4] - start[4] + 2.0 * sums[1] + corner_damping, contact = end[5] - start[5];
    const double impact = -p->memory.totals[IMPACT], released = p->memory.totals[RELEASED];
    const double net = work - (damping + contact + impact) + released;
    const double stored = (end[0] + end[1] + end[2]) - (start[0] + start[1] + start[2]);
    double strain = end[1], by_force = 0.0;
    if (corner[3] != 0.0) {
        strain -= q_end[0] * u_end[2];
        by_force = work - (q_end[0] * u_end[2] - q[0] * u[2]);
        work = 0.0;
    }
    const double values[10] = {end[0], strain, end[2], work, by_force, damping, contact, impact, released, stored - net};
    memcpy(row, values, sizeof values);
}

static int end_period(const Problem *p, PeriodBuffers *log, int64_t first_period, int64_t j, int64_t n) {
    const int64_t k = first_period + j, slot = p->memory.counts[SLOT], n_probes = p->fine.n_probes;
    const int64_t width = 3 + n_probes, *counts = p->memory.counts;
    const double *u = log->u + slot * (log->n_steps + 1) * width, *v = log->v + slot * (log->n_steps + 1) * n_probes;
    double *strobe = log->strobe + 2 * k * log->n_probes, *envelope = log->envelope + 2 * k * log->n_probes;
    double largest = 0.0, impulse = 0.0, energy = 0.0, *row = log->ledger + 10 * k;
    int is_finite = 1;
    store_level(p, log, j + 1);
    log->ends[3 * j] = log->effort[5 * k] = n;
    log->ends[3 * j + 1] = counts[N_EVENTS];
    log->ends[3 * j + 2] = counts[N_HITS];
    for (int i = 1; i < 5; i++) log->effort[5 * k + i] = 0;
    for (int64_t i = counts[OLD_HITS]; i < counts[N_HITS]; i++) impulse += log->impulse[i];
    for (int64_t i = counts[OLD_EVENTS]; i < counts[N_EVENTS]; i++) energy += greater(log->event_energy[i], 0.0);
    log->impulses[3 * k] = impulse;
    log->impulses[3 * k + 1] = counts[N_HITS] - counts[OLD_HITS];
    log->impulses[3 * k + 2] = energy;
    for (int64_t i = 0; i < log->n_probes; i++) {
        double low = u[3 + i], high = low;
        for (int64_t r = 1; r <= n; r++) {
            const double value = u[r * width + 3 + i];
            if (value < low || value != value) low = value;
            if (value > high || value != value) high = value;
        }
        strobe[i] = u[n * width + 3 + i];
        strobe[log->n_probes + i] = v[n * n_probes + i];
        envelope[i] = low;
        envelope[log->n_probes + i] = high;
        const double size = greater(fabs(low), fabs(high));
        if (size > largest || size != size) largest = size;
    }
    write_ledger(p, log, j, n, u, row);
    for (int i = 0; i < 10; i++) is_finite &= isfinite(row[i]) != 0;
    return is_finite && largest < log->limit;
}

/* Compute a block of periods; see `steps.run_plain`. `done` gets finished periods and steps. */
int64_t run_block(int64_t problem_at, int64_t log_at, int64_t first_period, int64_t *done, int64_t n_periods) {
    const Problem *p = (const Problem *)problem_at;
    PeriodBuffers *log = (PeriodBuffers *)log_at;
    int64_t *counts = p->memory.counts;
    for (int64_t j = done[0]; j < n_periods; j++) {
        int64_t step = done[1];
        int status = COMPLETED;
        if (step == 0) begin_period(p, log, j);
        while (step < log->n_steps && status == COMPLETED) {
            if (counts[N_EVENTS] + 1 > log->n_events || counts[N_HITS] + p->fine.n_pairs > log->n_hits) {
                done[0] = j;
                done[1] = step;
                return FULL;
            }
            status = make_step(p, log, ++step);
            if (status != COMPLETED) break;
            observe(&p->fine, &p->memory, log, step);
            if (counts[N_FRAMES] < log->n_frames && log->frame_steps[counts[N_FRAMES]] == step)
                keep_frame(&p->fine, (Memory *)&p->memory, log, step);
        }
        if (status != COMPLETED) step--;
        const int is_bounded = end_period(p, log, first_period, j, step);
        done[0] = j + 1;
        done[1] = 0;
        if (status < 0) return status;
        if (!is_bounded || status == DIVERGED) return DIVERGED;
    }
    return COMPLETED;
}
