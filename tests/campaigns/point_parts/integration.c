/* Time integration for tests/campaigns/points, by itself: M q'' + D q' + K q + sum of w f(z, z', s) = F(t), z = w.q, with few unknowns.
 *
 * Fourth order steps of Runge and Kutta; with rigid laws steps of Moreau's rule, where the wall takes the whole impulse and
 * friction at most its limit. Steps are fixed and small: this is to be simple, not fast.
 */
#include <math.h>
#include <stddef.h>

enum { max_dofs = 8, max_laws = 8, n_parameters = 6 };
enum kind {
   cubic_spring = 0, elastic_stop = 1, jenkins = 2, coulomb_tanh = 3, rigid_wall = 4, coulomb_rigid = 5,
   quadratic_damping = 6, cubic_damping = 7, polynomial = 8, piecewise_linear = 9,
   plane_x = 10, plane_y = 11, ring_x = 12, ring_y = 13,  /* jenkins_2d, annular_clearance: two laws, x before y */
   van_der_pol = 14,
   hertz = 15, electrostatic = 16, bouc_wen = 17, maxwell = 18, parametric = 19,
   film_x = 20, film_y = 21, balls_x = 22, balls_y = 23,  /* short_bearing, rolling_bearing */
   contact_x = 24, contact_y = 25, contact_n = 26         /* jenkins_2d with a normal load that varies */
};

/* All arrays by rows; what acts on the structure is divided by its mass. */
typedef struct {
   int n, n_laws, n_loads;
   const double *stiffness, *damping;      /* M^-1 K, M^-1 D, (n, n) */
   const double *frequency;                /* [rad/s], (n_loads) */
   const double *cosine, *sine;            /* M^-1 F, (n_loads, n) */
   const int *kind;                        /* (n_laws) */
   const double *shape, *kick;             /* w and M^-1 w, (n_laws, n) */
   const double *parameters;               /* as models.py has them, (n_laws, n_parameters) */
} problem_t;

static double product(int n, const double *a, const double *b) {
   double sum = 0.0;
   for (int i = 0; i < n; i++) sum += a[i] * b[i];
   return sum;
}

/* The law that is the other coordinate of law k in a plane; k itself for all others. */
static int partner(const problem_t *p, int k) {
   switch (p->kind[k]) {
   case plane_x: case ring_x: case film_x: case balls_x: case contact_x: return k + 1;
   case plane_y: case ring_y: case film_y: case balls_y: case contact_y: return k - 1;
   default: return k;
   }
}

static double clip(double value, double low, double high) { return value < low ? low : value > high ? high : value; }

/* Place of a slider after the coordinate has come to z. */
static double slid(const problem_t *p, int k, double z, double s) {
   if (p->kind[k] != jenkins) return s;
   double reach = p->parameters[n_parameters * k + 1] / p->parameters[n_parameters * k];
   return clip(s, z - reach, z + reach);
}

static const double pi = 3.14159265358979323846;

/* Force of a film of oil on x (axis 0) or y (axis 1), over the half circle in which it closes: q = mu R L^3, clearance, speed of
 * the rotor, 1: full film. The angle begin + pi/2 (1 - cos a) leaves the trapezoidal rule an error of fourth order. */
static double film(const double *q, double x, double y, double vx, double vy, int axis) {
   enum { n = 64 };
   double sum = 0.0, wx = vx + 0.5 * q[2] * y, wy = vy - 0.5 * q[2] * x, middle = atan2(wy, wx);
   for (int side = 0; side < (q[3] > 0.0 ? 2 : 1); side++) {
      for (int i = 1; i < n; i++) {
         double angle = middle + pi * side - 0.5 * pi * cos(pi * i / n), c = cos(angle), d = sin(angle);
         double thickness = fmax(q[1] - x * c - y * d, 0.01 * q[1]);
         sum += 0.5 * pi * sin(pi * i / n) * (pi / n) * (axis ? d : c) * (wx * c + wy * d) / (thickness * thickness * thickness);
      }
   }
   return q[0] * sum;
}

/* Force of balls: q = stiffness, exponent, clearance, number, frequency of their passage. */
static double balls(const double *q, double x, double y, double t, int axis) {
   double sum = 0.0;
   for (int i = 0; i < (int)q[3]; i++) {
      double angle = (q[4] * t + 2.0 * pi * i) / q[3], d = x * cos(angle) + y * sin(angle) - q[2];
      if (d > 0.0) sum += q[0] * pow(d, q[1]) * (axis ? sin(angle) : cos(angle));
   }
   return sum;
}

/* Normal load of the contact whose first row is k: q = stiffness, friction coefficient, normal stiffness, preload. */
static double normal_load(const double *q, double z_n) { return fmax(0.0, q[3] + q[2] * z_n); }

/* What share of its leash the slider of a contact keeps. */
static double leash(const double *q, double zx, double zy, double zn, double sx, double sy) {
   double length = hypot(zx - sx, zy - sy), reach = q[1] * normal_load(q, zn) / q[0];
   return length > reach ? reach / length : 1.0;
}

/* Rate of what a law remembers by a differential equation. */
static double memory_rate(const problem_t *p, int k, double z, double rate, double s) {
   const double *q = p->parameters + n_parameters * k;
   if (p->kind[k] == maxwell) return (z - s) / q[1];
   if (p->kind[k] != bouc_wen) return 0.0;
   double share = pow(fabs(s) / q[2], q[3]);
   return rate * (1.0 - share * (1.0 - q[4] + (s * rate > 0.0 ? q[4] : -q[4])));
}

/* Force of a law at time t, of the coordinates and rates of all laws and of what they remember. */
static double force(const problem_t *p, int k, double t, const double *all, const double *rates, const double *places) {
   const double *q = p->parameters + n_parameters * k;
   int other = partner(p, k);
   double z = all[k], beside = all[other], rate = rates[k], s = places[k], radius = hypot(z, beside), value;
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
   case hertz: return z > q[2] ? q[0] * pow(z - q[2], q[1]) * (1.0 + q[3] * rate) : 0.0;
   case electrostatic: value = (q[2] + q[3] * cos(q[5] * t) + q[4] * sin(q[5] * t)) / (q[1] - z); return -q[0] * value * value;
   case bouc_wen: return q[0] * (q[1] * z + (1.0 - q[1]) * s);
   case maxwell: return q[0] * (z - s);
   case parametric:
      value = z - clip(z, -q[4], q[4]);
      return (q[0] * cos(q[5] * t) + q[1] * sin(q[5] * t)) * value + (q[2] * cos(q[5] * t) + q[3] * sin(q[5] * t)) * rate;
   case film_x: return film(q, z, beside, rate, rates[other], 0);
   case film_y: return film(q, beside, z, rates[other], rate, 1);
   case balls_x: return balls(q, z, beside, t, 0);
   case balls_y: return balls(q, beside, z, t, 1);
   case contact_x: return q[0] * leash(q, z, beside, all[k + 2], s, places[other]) * (z - s);
   case contact_y: return q[0] * leash(q, z, beside, all[k + 1], s, places[other]) * (z - s);
   case contact_n: return normal_load(q, z);
   default: return 0.0;
   }
}

static void accelerate(const problem_t *p, double t, const double *q, const double *v, const double *s, double *a) {
   int n = p->n;
   double z[max_laws], rates[max_laws];
   for (int k = 0; k < p->n_laws; k++) z[k] = product(n, p->shape + k * n, q), rates[k] = product(n, p->shape + k * n, v);
   for (int i = 0; i < n; i++) a[i] = -product(n, p->stiffness + i * n, q) - product(n, p->damping + i * n, v);
   for (int k = 0; k < p->n_loads; k++) {
      double c = cos(p->frequency[k] * t), d = sin(p->frequency[k] * t);
      for (int i = 0; i < n; i++) a[i] += c * p->cosine[k * n + i] + d * p->sine[k * n + i];
   }
   for (int k = 0; k < p->n_laws; k++) {
      double f = force(p, k, t, z, rates, s);
      for (int i = 0; i < n; i++) a[i] -= f * p->kick[k * n + i];
   }
}

static void step_smooth(const problem_t *p, double t, double h, double *q, double *v, double *s) {
   double a[4][max_dofs], u[4][max_dofs], g[4][max_laws], there[max_dofs], places[max_laws];
   int n = p->n;
   for (int stage = 0; stage < 4; stage++) {
      double part = stage == 0 ? 0.0 : stage == 3 ? h : 0.5 * h;
      int last = stage > 0 ? stage - 1 : 0;
      for (int i = 0; i < n; i++) {
         there[i] = q[i] + (stage > 0 ? part * u[last][i] : 0.0);
         u[stage][i] = v[i] + (stage > 0 ? part * a[last][i] : 0.0);
      }
      for (int k = 0; k < p->n_laws; k++) places[k] = s[k] + (stage > 0 ? part * g[last][k] : 0.0);
      accelerate(p, t + part, there, u[stage], places, a[stage]);
      for (int k = 0; k < p->n_laws; k++) {
         g[stage][k] = memory_rate(p, k, product(n, p->shape + k * n, there), product(n, p->shape + k * n, u[stage]), places[k]);
      }
   }
   for (int k = 0; k < p->n_laws; k++) s[k] += h / 6.0 * (g[0][k] + 2.0 * g[1][k] + 2.0 * g[2][k] + g[3][k]);
   for (int i = 0; i < n; i++) {
      q[i] += h / 6.0 * (u[0][i] + 2.0 * u[1][i] + 2.0 * u[2][i] + u[3][i]);
      v[i] += h / 6.0 * (a[0][i] + 2.0 * a[1][i] + 2.0 * a[2][i] + a[3][i]);
   }
}

static void step_rigid(const problem_t *p, double t, double h, double *q, double *v, const double *s) {
   double a[max_dofs];
   int n = p->n;
   for (int i = 0; i < n; i++) q[i] += 0.5 * h * v[i];
   accelerate(p, t + 0.5 * h, q, v, s, a);
   for (int i = 0; i < n; i++) v[i] += h * a[i];
   for (int k = 0; k < p->n_laws; k++) {
      const double *w = p->shape + k * n, *kick = p->kick + k * n, *par = p->parameters + n_parameters * k;
      double z = product(n, w, q), impulse = product(n, w, v) / product(n, w, kick);
      if (p->kind[k] == rigid_wall) {
         int is_above = z >= par[1], is_below = par[2] > 0.0 && z <= -par[1];
         if (!(is_above && impulse > 0.0) && !(is_below && impulse < 0.0)) continue;
         impulse *= 1.0 + par[0];
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
         double share = fmin(1.0, p->parameters[n_parameters * k + 1] / p->parameters[n_parameters * k] / length);
         if (length > 0.0) s[k] = z - share * (z - s[k]), s[k + 1] = y - share * (y - s[k + 1]);
      } else if (p->kind[k] == contact_x) {
         double y = product(n, p->shape + (k + 1) * n, q), down = product(n, p->shape + (k + 2) * n, q);
         double share = leash(p->parameters + n_parameters * k, z, y, down, s[k], s[k + 1]);
         s[k] = z - share * (z - s[k]), s[k + 1] = y - share * (y - s[k + 1]);
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
   if (p->n > max_dofs || p->n_laws > max_laws) return -1;
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
