/* Motion of a linear structure with elastic stops at one coordinate, exact but for rounding: while no stop opens or closes it is a sum
 * of exponentials and of harmonics, and the times at which one does are found by bisection.
 *
 * The next such time is not before the distance to it divided by a bound of the speed, and no shorter steps than `shortest` are taken.
 */
#include <complex.h>
#include <math.h>

enum { most_values = 40, most_loads = 4, most_stops = 2, bisections = 30 };

/* Which stops are closed is a number, a bit each; all arrays by rows, one block for each such number. */
typedef struct {
   int n, n_loads, n_stops;                /* n: of displacements and velocities */
   const double *frequency;                /* [rad/s], (n_loads) */
   const double *side, *gap;               /* closed where side z > gap, (n_stops) */
   const double complex *rate;             /* eigenvalues [1/s], (n) */
   const double complex *modes, *inverse;  /* (n, n) */
   const double complex *driven;           /* state under a load, (n, n_loads) */
   const double *at_rest;                  /* state under the constant force of the closed stops, (n) */
   const double complex *seen;             /* coordinate in a mode, (n) */
   const double complex *seen_load;        /* (n_loads) */
   const double *seen_rest, *shortest;     /* (1) */
   const double *along;                    /* of a state: the coordinate, (n), one block for all */
} pieces_t;

static double complex turn(double phase) { return cos(phase) + sin(phase) * I; }

/* The coordinate at the time t, where the amplitudes of the modes are y. */
static double coordinate(const pieces_t *p, int closed, double t, const double complex *y) {
   const double complex *seen = p->seen + closed * p->n, *load = p->seen_load + closed * p->n_loads;
   double z = p->seen_rest[closed];
   for (int j = 0; j < p->n; j++) z += creal(seen[j] * y[j]);
   for (int m = 0; m < p->n_loads; m++) z += creal(load[m] * turn(p->frequency[m] * t));
   return z;
}

static void advance(const pieces_t *p, int closed, double h, const double complex *y, double complex *next) {
   const double complex *rate = p->rate + closed * p->n;
   for (int j = 0; j < p->n; j++) next[j] = y[j] * (exp(creal(rate[j]) * h) * turn(cimag(rate[j]) * h));
}

static double driven_part(const pieces_t *p, int closed, int i, double t) {
   double x = p->at_rest[closed * p->n + i];
   for (int m = 0; m < p->n_loads; m++) {
      x += creal(p->driven[(closed * p->n + i) * p->n_loads + m] * turn(p->frequency[m] * t));
   }
   return x;
}

static void to_state(const pieces_t *p, int closed, double t, const double complex *y, double *x) {
   for (int i = 0; i < p->n; i++) {
      x[i] = driven_part(p, closed, i, t);
      for (int j = 0; j < p->n; j++) x[i] += creal(p->modes[(closed * p->n + i) * p->n + j] * y[j]);
   }
}

static void to_modes(const pieces_t *p, int closed, double t, const double *x, double complex *y) {
   double free[most_values];
   for (int i = 0; i < p->n; i++) free[i] = x[i] - driven_part(p, closed, i, t);
   for (int j = 0; j < p->n; j++) {
      y[j] = 0.0;
      for (int i = 0; i < p->n; i++) y[j] += p->inverse[(closed * p->n + j) * p->n + i] * free[i];
   }
}

static int closed_at(const pieces_t *p, double z) {
   int closed = 0;
   for (int k = 0; k < p->n_stops; k++) closed |= (p->side[k] * z > p->gap[k]) << k;
   return closed;
}

/* Marches from the state x at time `t` on, which returns the last one; the coordinate at t + i look goes to out(i), i < n_looks.
 * Gives the number of looks done: fewer where more than `most` steps are needed, which
 * returns how many are left. */
long pieces_march(const pieces_t *p, double *x, double t, double look, long n_looks, long *most, double *out) {
   double complex y[most_values], next[most_values], little[most_values];
   double z = 0.0, since = 0.0;
   if (p->n > most_values || p->n_loads > most_loads || p->n_stops > most_stops) return -1;
   for (int i = 0; i < p->n; i++) z += p->along[i] * x[i];
   int closed = closed_at(p, z), is_new = 1;
   to_modes(p, closed, t, x, y);
   for (long done = 0; done < n_looks; since = 0.0) {
      out[done] = coordinate(p, closed, t + (double)done * look, y);
      while (since < look) {
         const double complex *seen = p->seen + closed * p->n, *load = p->seen_load + closed * p->n_loads;
         double now = t + (double)done * look + since, speed = 0.0, near = HUGE_VAL, h, least = p->shortest[closed];
         if (--*most < 0) return done;
         if (is_new) advance(p, closed, least, (double complex[most_values]){[0 ... most_values - 1] = 1.0}, little);
         is_new = 0;
         z = coordinate(p, closed, now, y);
         for (int j = 0; j < p->n; j++) speed += cabs(seen[j] * y[j] * p->rate[closed * p->n + j]);
         for (int m = 0; m < p->n_loads; m++) speed += cabs(load[m]) * p->frequency[m];
         for (int k = 0; k < p->n_stops; k++) near = fmin(near, fabs(p->side[k] * z - p->gap[k]));
         h = fmin(fmax(near / speed, least), look - since);
         if (h == least) {
            for (int j = 0; j < p->n; j++) next[j] = y[j] * little[j];
         } else {
            advance(p, closed, h, y, next);
         }
         int then = closed_at(p, coordinate(p, closed, now + h, next));
         if (then != closed) {
            double low = 0.0, high = h;
            for (int i = 0; i < bisections; i++) {
               double middle = 0.5 * (low + high);
               advance(p, closed, middle, y, next);
               int there = closed_at(p, coordinate(p, closed, now + middle, next));
               if (there == closed) low = middle;
               else high = middle, then = there;
            }
            h = high;
            advance(p, closed, h, y, next);
            to_state(p, closed, now + h, next, x);
            closed = then;
            to_modes(p, closed, now + h, x, next);
            is_new = 1;
         }
         for (int j = 0; j < p->n; j++) y[j] = next[j];
         since = h >= look - since ? look : since + h;
      }
      done++;
   }
   to_state(p, closed, t + (double)n_looks * look, y, x);
   return n_looks;
}
