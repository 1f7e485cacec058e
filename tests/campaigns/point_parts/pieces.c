/* Motion of a linear structure with elastic stops at one coordinate, exact but for rounding: while no stop opens or closes it is a sum
 * of exponentials and of harmonics, and the times at which one does are found by halving steps.
 *
 * The next such time is not before the distance to it divided by a bound of the speed, and no shorter steps than `shortest` are taken
 * elsewhere. Steps are `shortest` times powers of two, so that what a wave turns by in each is known beforehand.
 */
#include <complex.h>
#include <math.h>
#include <string.h>

enum { max_values = 40, max_loads = 4, max_waves = max_values + max_loads, max_stops = 2, halvings = 30, doublings = 24 };
enum { n_levels = halvings + doublings + 1 };

/* Which stops are closed is a number, a bit each; all arrays by rows, one block for each such number. Waves are the modes, of a pair
 * that is conjugate one, then the loads. */
typedef struct {
   int n, n_modes, n_loads, n_stops;       /* n: of displacements and velocities */
   const double *frequency;                /* [rad/s], (n_loads) */
   const double *side, *gap;               /* closed where side z > gap, (n_stops) */
   const double complex *rate;             /* of waves [1/s], (n_modes + n_loads) */
   const double complex *shapes;           /* state of waves, (n, n_modes + n_loads) */
   const double complex *inverse;          /* (n_modes, n) */
   const double *at_rest;                  /* state under the constant force of the closed stops, (n) */
   const double complex *seen;             /* coordinate of waves, (n_modes + n_loads) */
   const double *seen_rest, *shortest;     /* (1) */
   const double *along;                    /* of a state: the coordinate, (n), one block for all */
} pieces_t;

typedef struct {
   double length[n_levels];                /* [s] */
   double complex turned[n_levels][max_waves];
} levels_t;

static double complex turn(double phase) { return cos(phase) + sin(phase) * I; }

static int n_waves(const pieces_t *p) { return p->n_modes + p->n_loads; }

static double coordinate(const pieces_t *p, int closed, const double complex *y) {
   const double complex *seen = p->seen + closed * n_waves(p);
   double z = p->seen_rest[closed];
   for (int j = 0; j < n_waves(p); j++) z += creal(seen[j]) * creal(y[j]) - cimag(seen[j]) * cimag(y[j]);
   return z;
}

static double bound_of_speed(const pieces_t *p, int closed, const double complex *y) {
   double speed = 0.0;
   for (int i = closed * n_waves(p), j = 0; j < n_waves(p); j++) speed += cabs(p->seen[i + j] * p->rate[i + j] * y[j]);
   return speed;
}

static void advance(const pieces_t *p, int closed, double h, const double complex *y, double complex *next) {
   const double complex *rate = p->rate + closed * n_waves(p);
   for (int j = 0; j < n_waves(p); j++) next[j] = y[j] * (exp(creal(rate[j]) * h) * turn(cimag(rate[j]) * h));
}

static void step(const pieces_t *p, const double complex *turned, const double complex *y, double complex *next) {
   for (int j = 0; j < n_waves(p); j++) next[j] = y[j] * turned[j];
}

static void set_loads(const pieces_t *p, double t, double complex *y) {
   for (int m = 0; m < p->n_loads; m++) y[p->n_modes + m] = turn(p->frequency[m] * t);
}

static void to_state(const pieces_t *p, int closed, const double complex *y, double *x) {
   for (int i = 0; i < p->n; i++) {
      x[i] = p->at_rest[closed * p->n + i];
      for (int j = 0; j < n_waves(p); j++) x[i] += creal(p->shapes[(closed * p->n + i) * n_waves(p) + j] * y[j]);
   }
}

static void to_waves(const pieces_t *p, int closed, double t, const double *x, double complex *y) {
   double free[max_values];
   memset(y, 0, (size_t)p->n_modes * sizeof *y);
   set_loads(p, t, y);
   to_state(p, closed, y, free);
   for (int i = 0; i < p->n; i++) free[i] = x[i] - free[i];
   for (int j = 0; j < p->n_modes; j++) {
      for (int i = 0; i < p->n; i++) y[j] += p->inverse[(closed * p->n_modes + j) * p->n + i] * free[i];
   }
}

static int closed_at(const pieces_t *p, double z) {
   int closed = 0;
   for (int k = 0; k < p->n_stops; k++) closed |= (p->side[k] * z > p->gap[k]) << k;
   return closed;
}

/* Integrates from the state x at time `t` on, which returns the last one; the coordinate at t + i look goes to out(i), i < n_looks.
 * Gives the number of looks done: fewer where more than `most` steps are needed, which
 * returns how many are left. */
long pieces_integration(const pieces_t *p, double *x, double t, double look, long n_looks, long *most, double *out) {
   double complex waves[2][max_waves], *y = waves[0], *next = waves[1], *swapped;
   levels_t levels[1 << max_stops];
   double z = 0.0;
   if (p->n > max_values || p->n_loads > max_loads || p->n_stops > max_stops) return -1;
   double complex unit[max_waves];
   for (int j = 0; j < n_waves(p); j++) unit[j] = 1.0;
   for (int closed = 0; closed < 1 << p->n_stops; closed++) {
      for (int l = 0; l < n_levels; l++) {
         levels[closed].length[l] = ldexp(p->shortest[closed], l - halvings);
         advance(p, closed, levels[closed].length[l], unit, levels[closed].turned[l]);
      }
   }
   for (int i = 0; i < p->n; i++) z += p->along[i] * x[i];
   int closed = closed_at(p, z);
   to_waves(p, closed, t, x, y);
   for (long done = 0; done < n_looks; done++) {
      double begin = t + (double)done * look, since = 0.0;
      set_loads(p, begin, y);
      double speed = bound_of_speed(p, closed, y);
      z = out[done] = coordinate(p, closed, y);
      while (since < look) {
         if (--*most < 0) return done;
         double near = HUGE_VAL, left = look - since;
         for (int k = 0; k < p->n_stops; k++) {
            double distance = fabs(p->side[k] * z - p->gap[k]);
            if (distance < near) near = distance;
         }
         double many = near / (speed * p->shortest[closed]);
         int level = halvings + (many < 2.0 ? 0 : many < ldexp(1.0, doublings) ? ilogb(many) : doublings);
         double h = levels[closed].length[level];
         if (h < left) {
            step(p, levels[closed].turned[level], y, next);
         } else {
            h = left;
            advance(p, closed, h, y, next);
         }
         z = coordinate(p, closed, next);
         int then = closed_at(p, z);
         if (then != closed) {
            double past = h;
            for (h = 0.0, level--; level >= 0; level--) {
               double further = levels[closed].length[level];
               if (h + further >= past) continue;
               step(p, levels[closed].turned[level], y, next);
               int there = closed_at(p, coordinate(p, closed, next));
               if (there == closed) {
                  h += further;
                  swapped = y, y = next, next = swapped;
               } else {
                  then = there;
                  past = h + further;
               }
            }
            advance(p, closed, past - h, y, next);
            h = past;
            to_state(p, closed, next, x);
            closed = then;
            to_waves(p, closed, begin + since + h, x, next);
            speed = bound_of_speed(p, closed, next);
            z = coordinate(p, closed, next);
         }
         swapped = y, y = next, next = swapped;
         since = h >= left ? look : since + h;
      }
   }
   set_loads(p, t + (double)n_looks * look, y);
   to_state(p, closed, y, x);
   return n_looks;
}
