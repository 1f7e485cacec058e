/* Time integration for tests/points, by itself: M q'' + D q' + K q + sum of w f(z, z', s) = F(t), z = w.q, with few unknowns.
 *
 * Fourth order steps of Runge and Kutta; with rigid laws steps of Moreau's rule, where the wall takes the whole impulse and
 * friction at most its limit. Steps are fixed and small: this is to be simple, not fast.
 */
#include <math.h>
#include <stddef.h>

enum { most_dofs = 8, most_laws = 4 };
enum kind {
   cubic_spring = 0, elastic_stop = 1, jenkins = 2, coulomb_tanh = 3, rigid_wall = 4, coulomb_rigid = 5,
   quadratic_damping = 6, cubic_damping = 7, polynomial = 8, piecewise_linear = 9,
   plane_x = 10, plane_y = 11, ring_x = 12, ring_y = 13,  /* jenkins_2d, annular_clearance: two laws, x before y */
   van_der_pol = 14
};

/* All arrays by rows; what acts on the structure is divided by its mass. */
typedef struct {
   int n, n_laws, n_loads;
   const double *stiffness, *damping;      /* M^-1 K, M^-1 D, (n, n) */
   const double *frequency;                /* [rad/s], (n_loads) */
   const double *cosine, *sine;            /* M^-1 F, (n_loads, n) */
   const int *kind;                        /* (n_laws) */
   const double *shape, *kick;             /* w and M^-1 w, (n_laws, n) */
   const double *parameters;               /* stiffness or limit; gap, limit or velocity; 1: two sides, (n_laws, 3) */
} problem_t;

static double product(int n, const double *a, const double *b) {
   double sum = 0.0;
   for (int i = 0; i < n; i++) sum += a[i] * b[i];
   return sum;
}

/* The law that is the other coordinate of law k in a plane; k itself for all others. */
static int partner(const problem_t *p, int k) {
   if (p->kind[k] == plane_x || p->kind[k] == ring_x) return k + 1;
   if (p->kind[k] == plane_y || p->kind[k] == ring_y) return k - 1;
   return k;
}

static double clip(double value, double low, double high) { return value < low ? low : value > high ? high : value; }

/* Place of a slider after the coordinate has come to z. */
static double slid(const problem_t *p, int k, double z, double s) {
   if (p->kind[k] != jenkins) return s;
   double reach = p->parameters[3 * k + 1] / p->parameters[3 * k];
   return clip(s, z - reach, z + reach);
}

/* Force of a law; the other coordinate of a law in the plane is `beside`. */
static double force(const problem_t *p, int k, double z, double beside, double rate, double s) {
   const double *q = p->parameters + 3 * k;
   double radius = hypot(z, beside);
   switch (p->kind[k]) {
   case cubic_spring: return q[0] * z * z * z;
   case elastic_stop: return q[0] * (fmax(z - q[1], 0.0) + (q[2] > 0.0 ? fmin(z + q[1], 0.0) : 0.0));
   case jenkins: return q[0] * (z - slid(p, k, z, s));
   case coulomb_tanh: return q[0] * tanh(rate / q[1]);
   case quadratic_damping: return q[0] * fabs(rate) * rate;
   case cubic_damping: return q[0] * rate * rate * rate;
   case polynomial: return q[0] * z * z * z + q[1] * z * z;
   case piecewise_linear: return q[0] * fmax(z - q[1], 0.0) + q[2] * fmin(z + q[1], 0.0);
   case plane_x:
   case plane_y: return q[0] * (z - s);
   case ring_x:
   case ring_y: return radius > q[1] ? q[0] * (radius - q[1]) * z / radius : 0.0;
   case van_der_pol: return -q[0] * (1.0 - z * z / (q[1] * q[1])) * rate;
   default: return 0.0;
   }
}

static void accelerate(const problem_t *p, double t, const double *q, const double *v, const double *s, double *a) {
   int n = p->n;
   double z[most_laws];
   for (int k = 0; k < p->n_laws; k++) z[k] = product(n, p->shape + k * n, q);
   for (int i = 0; i < n; i++) a[i] = -product(n, p->stiffness + i * n, q) - product(n, p->damping + i * n, v);
   for (int k = 0; k < p->n_loads; k++) {
      double c = cos(p->frequency[k] * t), d = sin(p->frequency[k] * t);
      for (int i = 0; i < n; i++) a[i] += c * p->cosine[k * n + i] + d * p->sine[k * n + i];
   }
   for (int k = 0; k < p->n_laws; k++) {
      double f = force(p, k, z[k], z[partner(p, k)], product(n, p->shape + k * n, v), s[k]);
      for (int i = 0; i < n; i++) a[i] -= f * p->kick[k * n + i];
   }
}

static void step_smooth(const problem_t *p, double t, double h, double *q, double *v, const double *s) {
   double a[4][most_dofs], u[4][most_dofs], there[most_dofs];
   int n = p->n;
   for (int stage = 0; stage < 4; stage++) {
      double part = stage == 0 ? 0.0 : stage == 3 ? h : 0.5 * h;
      int last = stage > 0 ? stage - 1 : 0;
      for (int i = 0; i < n; i++) {
         there[i] = q[i] + (stage > 0 ? part * u[last][i] : 0.0);
         u[stage][i] = v[i] + (stage > 0 ? part * a[last][i] : 0.0);
      }
      accelerate(p, t + part, there, u[stage], s, a[stage]);
   }
   for (int i = 0; i < n; i++) {
      q[i] += h / 6.0 * (u[0][i] + 2.0 * u[1][i] + 2.0 * u[2][i] + u[3][i]);
      v[i] += h / 6.0 * (a[0][i] + 2.0 * a[1][i] + 2.0 * a[2][i] + a[3][i]);
   }
}

static void step_rigid(const problem_t *p, double t, double h, double *q, double *v, const double *s) {
   double a[most_dofs];
   int n = p->n;
   for (int i = 0; i < n; i++) q[i] += 0.5 * h * v[i];
   accelerate(p, t + 0.5 * h, q, v, s, a);
   for (int i = 0; i < n; i++) v[i] += h * a[i];
   for (int k = 0; k < p->n_laws; k++) {
      const double *w = p->shape + k * n, *kick = p->kick + k * n, *par = p->parameters + 3 * k;
      double z = product(n, w, q), impulse = product(n, w, v) / product(n, w, kick);
      if (p->kind[k] == rigid_wall) {
         int is_above = z >= par[1], is_below = par[2] > 0.0 && z <= -par[1];
         if (!(is_above && impulse > 0.0) && !(is_below && impulse < 0.0)) continue;
      } else if (p->kind[k] == coulomb_rigid) {
         impulse = clip(impulse, -h * par[0], h * par[0]);
      } else {
         continue;
      }
      for (int i = 0; i < n; i++) v[i] -= impulse * kick[i];
   }
   for (int i = 0; i < n; i++) q[i] += 0.5 * h * v[i];
}

/* Takes all sliders to where the coordinates have come; in a plane the leash pulls them straight. */
static void slide(const problem_t *p, const double *q, double *s) {
   int n = p->n;
   for (int k = 0; k < p->n_laws; k++) {
      double z = product(n, p->shape + k * n, q);
      if (p->kind[k] == plane_x) {
         double y = product(n, p->shape + (k + 1) * n, q), length = hypot(z - s[k], y - s[k + 1]);
         double share = fmin(1.0, p->parameters[3 * k + 1] / p->parameters[3 * k] / length);
         if (length > 0.0) s[k] = z - share * (z - s[k]), s[k + 1] = y - share * (y - s[k + 1]);
      } else {
         s[k] = slid(p, k, z, s[k]);
      }
   }
}

/* Integrates n_steps from a state on, which returns the last one; displacements of each stride-th step from `first` on go to `out`,
 * (any, n). Gives the number of steps done: fewer where the motion has left all bounds. */
long assess_integration(const problem_t *p, double *q, double *v, double *s, double h, long n_steps, long first, long stride, double bound,
                 double *out) {
   int is_rigid = 0;
   if (p->n > most_dofs || p->n_laws > most_laws) return -1;
   for (int k = 0; k < p->n_laws; k++) is_rigid |= p->kind[k] == rigid_wall || p->kind[k] == coulomb_rigid;
   for (long i = 0; i < n_steps; i++) {
      if (i >= first && (i - first) % stride == 0) {
         for (int k = 0; k < p->n; k++) out[(i - first) / stride * p->n + k] = q[k];
      }
      if (is_rigid) step_rigid(p, (double)i * h, h, q, v, s);
      else step_smooth(p, (double)i * h, h, q, v, s);
      slide(p, q, s);
      for (int k = 0; k < p->n; k++) {
         if (!(fabs(q[k]) < bound)) return i;
      }
   }
   return n_steps;
}
