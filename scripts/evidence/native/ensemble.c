/* Eight runs of two laminae side by side: a trial on the kernel of laminae.c.
 *
 * Where laminae.c has one number, an ensemble has eight, one for each run, in one register of AVX-512:
 *
 *     a field       | place 0: runs 0-7 | place 1: runs 0-7 | ... |, places as in laminae.c
 *
 * Runs share operators. With OWN each has coefficients of its own (another time step), otherwise all
 * have those of the first. All runs make a step without contact at once. A run whose gap closes goes
 * back to the start of the step and makes it alone, by laminae.c, as long as a spring acts.
 */
#include "laminae.c"
#include <immintrin.h>

enum { RUNS = 8 };
typedef double v8 __attribute__((vector_size(64)));

static inline v8 get(const double *field, int64_t place) { return *(const v8 *)(field + RUNS * place); }
static inline void put(double *field, int64_t place, v8 x) { *(v8 *)(field + RUNS * place) = x; }
static inline v8 all(double x) { return (v8)_mm512_set1_pd(x); }
static inline v8 fuse(v8 a, v8 b, v8 c) { return (v8)_mm512_fmadd_pd((__m512d)a, (__m512d)b, (__m512d)c); }
static inline v8 least(v8 a, v8 b) { return (v8)_mm512_min_pd((__m512d)a, (__m512d)b); }

/* A coefficient of all runs. */
#ifdef OWN
static inline v8 of(const double *tape, int64_t i) { return get(tape, i); }
#else
static inline v8 of(const double *tape, int64_t i) { return all(tape[i]); }
#endif

typedef struct {
    const double *solution, *forth, *form, *coefficients, *rest, *base;
    int64_t size, is_diagonal;
} Tapes;

/* Both chains of a lamina, c and c + 1, from the ends to the middle; the forces act on the first row.
 * x[k][i]: chain c + k, component i. */
static inline __attribute__((always_inline)) void eliminate(
    const Tapes *s, const double *restrict u, const double *restrict v, double *restrict y, const v8 *force0, const v8 *force1, int c
) {
    const double *restrict b = s->forth;
    v8 now[2][2], before[2][2], next[2][2], r[2][2], sum[2][2];
#pragma GCC unroll 2
    for (int k = 0; k < 2; k++) {
        r[k][0] = force0[c + k];
        r[k][1] = force1[c + k];
#pragma GCC unroll 2
        for (int i = 0; i < 2; i++) {
            before[k][i] = sum[k][i] = all(0.0);
            now[k][i] = fuse(of(s->coefficients, 4 * S + c + k), get(v, 4 * i + c + k), get(u, 4 * i + c + k));
        }
    }
    for (int64_t row = 0; row < s->size; row += 8) {
        const int64_t ahead = row + 8 < s->size ? row + 8 : 0;
#pragma GCC unroll 2
        for (int k = 0; k < 2; k++)
#pragma GCC unroll 2
            for (int i = 0; i < 2; i++) {
                const int64_t place = ahead + 4 * i + c + k;
                const v8 w = fuse(of(s->coefficients, 4 * S + c + k), get(v, place), get(u, place));
                next[k][i] = ahead ? w : now[1 - k][i];
            }
#pragma GCC unroll 2
        for (int k = 0; k < 2; k++) {
            const int64_t at = (s->is_diagonal ? 3 : 8) * row + c + k, lower = at + (s->is_diagonal ? 8 : 48);
#pragma GCC unroll 2
            for (int i = 0; i < 2; i++) {
                v8 x = r[k][i];
                if (s->is_diagonal) {
                    x = fuse(of(b, at + 4 * i), now[k][i], x);
                } else {
                    x = fuse(of(b, at + 8 * i), before[k][0], x);
                    x = fuse(of(b, at + 8 * i + 4), before[k][1], x);
                    x = fuse(of(b, at + 8 * i + 16), now[k][0], x);
                    x = fuse(of(b, at + 8 * i + 20), now[k][1], x);
                    x = fuse(of(b, at + 8 * i + 32), next[k][0], x);
                    x = fuse(of(b, at + 8 * i + 36), next[k][1], x);
                }
                x = fuse(of(b, lower + 8 * i), sum[k][0], x);
                r[k][i] = fuse(of(b, lower + 8 * i + 4), sum[k][1], x);
            }
#pragma GCC unroll 2
            for (int i = 0; i < 2; i++) {
                put(y, row + 4 * i + c + k, sum[k][i] = r[k][i]);
                r[k][i] = all(0.0);
                before[k][i] = now[k][i];
                now[k][i] = next[k][i];
            }
        }
    }
}

/* Both chains of a lamina back to the ends, the new state (L1, L2), z^T C z; the lower lamina, whose
 * c is 0, comes last and sees the gaps. */
static inline __attribute__((always_inline)) v8 complete(
    const Tapes *s, const double *restrict u, const double *restrict v, const double *restrict y,
    double *restrict u_new, double *restrict v_new, int c, v8 *gap
) {
    const int64_t last = s->size - 8;
    const double *restrict t = s->solution, *restrict form = s->form, *restrict held = s->is_diagonal ? u : v;
    v8 x[2][2], z[2][2], z_next[2][2], loss[2][2], smallest = *gap;
#pragma GCC unroll 2
    for (int k = 0; k < 2; k++)
#pragma GCC unroll 2
        for (int i = 0; i < 2; i++) {
            x[k][i] = get(y, last + 4 * i + c + 1 - k);
            loss[k][i] = all(0.0);
        }
    for (int64_t row = last; row >= 0; row -= 8) {
#pragma GCC unroll 2
        for (int k = 0; k < 2; k++) {
            const int64_t at = 6 * row + c + k;
            const v8 y0 = get(y, row + c + k), y1 = get(y, row + 4 + c + k);
            v8 own[2];
#pragma GCC unroll 2
            for (int i = 0; i < 2; i++) {
                own[i] = fuse(of(t, at + 8 * i + 20), y1, of(t, at + 8 * i + 16) * y0);
                own[i] = fuse(of(t, at + 8 * i + 32), x[k][0], own[i]);
                own[i] = fuse(of(t, at + 8 * i + 36), x[k][1], own[i]);
            }
#pragma GCC unroll 2
            for (int i = 0; i < 2; i++) {
                const int64_t place = row + 4 * i + c + k;
                x[k][i] = own[i];
                z[k][i] = fuse(of(s->coefficients, 4 * KAPPA + c + k), get(held, place), own[i]);
                put(u_new, place, fuse(of(s->coefficients, 4 * TO_U + c + k), z[k][i], get(u, place)));
                put(v_new, place, fuse(of(s->coefficients, 4 * MINUS_RHO + c + k), get(v, place), z[k][i]));
            }
            if (c == 0) smallest = least(get(u_new, row + 2 + k) - get(u_new, row + k) + of(s->rest, row / 2 + k), smallest);
        }
#pragma GCC unroll 2
        for (int k = 0; k < 2; k++) {
            const int64_t at = row / 2 * 7 + c + k;
            const v8 after0 = row == last ? z[1 - k][0] : z_next[k][0];
            const v8 after1 = row == last ? z[1 - k][1] : z_next[k][1];
            v8 flow0 = fuse(of(form, at + 4), z[k][1], of(form, at) * z[k][0]), flow1 = of(form, at + 8) * z[k][1];
            flow0 = fuse(of(form, at + 12), after0, flow0);
            flow1 = fuse(of(form, at + 20), after0, flow1);
            flow0 = fuse(of(form, at + 16), after1, flow0);
            flow1 = fuse(of(form, at + 24), after1, flow1);
            loss[k][0] = fuse(z[k][0], flow0, loss[k][0]);
            loss[k][1] = fuse(z[k][1], flow1, loss[k][1]);
        }
#pragma GCC unroll 2
        for (int k = 0; k < 2; k++)
#pragma GCC unroll 2
            for (int i = 0; i < 2; i++) z_next[k][i] = z[k][i];
    }
    *gap = smallest;
    return (loss[0][0] + loss[0][1]) + (loss[1][0] + loss[1][1]);
}

static void copy_out(const double *u, const double *v, int run, Memory *m, int64_t size) {
    for (int64_t k = 0; k < size; k++) {
        m->X[k] = u[RUNS * k + run];
        m->X[size + k] = v[RUNS * k + run];
    }
}

static void copy_in(double *u, double *v, int run, const Memory *m, int64_t size) {
    for (int64_t k = 0; k < size; k++) {
        u[RUNS * k + run] = m->X[k];
        v[RUNS * k + run] = m->X[size + k];
    }
}

#ifdef OWN
/* A tape of all runs, a number of each; `work` gets it and moves on. */
static const double *tape_of(Problem **p, size_t member, int64_t n, double **work) {
    double *tape = *work;
    for (int run = 0; run < RUNS; run++) {
        const double *own = *(double **)((char *)&p[run]->fine + member);
        for (int64_t k = 0; k < n; k++) tape[RUNS * k + run] = own[k];
    }
    *work += RUNS * n;
    return tape;
}
#endif

/* Compute a block of whole periods of eight runs, with all that `run_block` writes.
 *
 * work: room for 40 numbers of each place, and 180 more with OWN, from the start of a cache line.
 * n_alone: steps that runs have made alone.
 */
int64_t run_ensemble(int64_t *problems, int64_t *logs, int64_t first_period, int64_t n_periods, double *work, int64_t *n_alone) {
    Problem *p[RUNS];
    PeriodBuffers *log[RUNS];
    for (int run = 0; run < RUNS; run++) {
        p[run] = (Problem *)problems[run];
        log[run] = (PeriodBuffers *)logs[run];
    }
    const System *s = &p[0]->fine;
    const int64_t size = s->size, N = log[0]->n_steps, n_v = s->n_probes, n_u = 3 + n_v;
    double *state[2][2] = {{work, work + RUNS * size}, {work + 2 * RUNS * size, work + 3 * RUNS * size}};
    double *y = work + 4 * RUNS * size;
    Tapes t = {s->solution, s->forth, s->form, s->coefficients, s->rest, s->base, size, s->is_diagonal_load};
#ifdef OWN
    double *room = work + 5 * RUNS * size;
    t.solution = tape_of(p, offsetof(System, solution), 6 * size, &room);
    t.forth = tape_of(p, offsetof(System, forth), (t.is_diagonal ? 3 : 8) * size, &room);
    t.form = tape_of(p, offsetof(System, form), size / 2 * 7, &room);
    t.coefficients = tape_of(p, offsetof(System, coefficients), 16, &room);
    t.rest = tape_of(p, offsetof(System, rest), size / 2, &room);
    t.base = tape_of(p, offsetof(System, base), 3 * size, &room);
#endif
    v8 dt, weight, dissipated;
    int is_alone[RUNS], present = 0;
    for (int run = 0; run < RUNS; run++) {
        Memory *m = &p[run]->memory;
        copy_in(state[0][0], state[0][1], run, m, size);
        dt[run] = p[run]->fine.scheme.time_step;
        weight[run] = p[run]->fine.scheme.weight;
        dissipated[run] = m->totals[DISSIPATED];
        is_alone[run] = m->counts[N_SPRINGS] > 0;
    }
    const double after = s->scheme.theta, before = 1.0 - after;
    for (int64_t j = 0; j < n_periods; j++) {
        double *rows_u[RUNS], *rows_v[RUNS];
        for (int run = 0; run < RUNS; run++) {
            begin_period(p[run], log[run], j);
            const int64_t first = p[run]->memory.counts[SLOT] * (N + 1);
            rows_u[run] = log[run]->u + first * n_u;
            rows_v[run] = log[run]->v + first * n_v;
        }
        for (int64_t step = 1; step <= N; step++) {
            const double *u = state[present][0], *v = state[present][1];
            double *u_new = state[!present][0], *v_new = state[!present][1];
            v8 q[3], force0[4], force1[4], gap = all(INFINITY), seen[3];
            for (int run = 0; run < RUNS; run++) {
                const double *base = log[run]->base_states + 3 * step;
                for (int i = 0; i < 3; i++) q[i][run] = after * base[i] + before * base[i - 3];
            }
            for (int i = 0; i < 3; i++) q[i] *= -dt;
            for (int c = 0; c < 4; c++) {
                force0[c] = fuse(q[0], of(t.base, 2 * size + c), fuse(q[1], of(t.base, size + c), q[2] * of(t.base, c)));
                force1[c] = fuse(q[0], of(t.base, 2 * size + 4 + c), fuse(q[1], of(t.base, size + 4 + c), q[2] * of(t.base, 4 + c)));
            }
            eliminate(&t, u, v, y, force0, force1, 0);
            eliminate(&t, u, v, y, force0, force1, 2);
            v8 flow = complete(&t, u, v, y, u_new, v_new, 2, &gap);
            flow = complete(&t, u, v, y, u_new, v_new, 0, &gap) + flow;
            dissipated += weight * flow;
            for (int i = 0; i < 3; i++) {
                v8 x[4];
                for (int c = 0; c < 4; c++)
                    x[c] = fuse(of(t.base, i * size + 4 + c), get(u_new, 4 + c), of(t.base, i * size + c) * get(u_new, c));
                seen[i] = (x[0] + x[1]) + (x[2] + x[3]);
            }
            for (int run = 0; run < RUNS; run++) {
                Memory *m = &p[run]->memory;
                if (!is_alone[run] && (gap[run] > 0.0 || p[run]->law.kind == NONE)) {
                    double *row_u = rows_u[run] + step * n_u, *row_v = rows_v[run] + step * n_v;
                    for (int i = 0; i < 3; i++) row_u[i] = seen[i][run];
                    for (int64_t k = 0; k < n_v; k++) {
                        row_u[3 + k] = u_new[RUNS * s->selected[k] + run];
                        row_v[k] = v_new[RUNS * s->selected[k] + run];
                    }
                    continue;
                }
                if (!is_alone[run]) {
                    copy_out(u, v, run, m, size);
                    memcpy(m->base, log[run]->base_states + 3 * (step - 1), 3 * sizeof(double));
                    m->totals[DISSIPATED] = dissipated[run] - weight[run] * flow[run];
                }
                if (m->counts[N_EVENTS] + 1 > log[run]->n_events || m->counts[N_HITS] + s->n_pairs > log[run]->n_hits) return FULL;
                const int status = make_step(p[run], log[run], step);
                if (status != COMPLETED) return status;
                observe(&p[run]->fine, m, log[run], step);
                ++*n_alone;
                is_alone[run] = m->counts[N_SPRINGS] > 0;
                if (!is_alone[run]) {
                    copy_in(u_new, v_new, run, m, size);
                    dissipated[run] = m->totals[DISSIPATED];
                }
            }
            present = !present;
        }
        for (int run = 0; run < RUNS; run++) {
            Memory *m = &p[run]->memory;
            if (!is_alone[run]) {
                copy_out(state[present][0], state[present][1], run, m, size);
                memcpy(m->base, log[run]->base_states + 3 * N, 3 * sizeof(double));
                m->totals[DISSIPATED] = dissipated[run];
            }
            if (!end_period(p[run], log[run], first_period, j, N)) return DIVERGED;
        }
    }
    return COMPLETED;
}
