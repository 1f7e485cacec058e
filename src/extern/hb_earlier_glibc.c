/* What a wheel needs of the GNU C library 2.35, made of what 2.34 has, so that the wheel runs with this one as well. The linker puts
   these functions in the place of all calls (--wrap). hypot of 2.35 differs from the one before by errno alone; of two tanh, sinh,
   atan2 or hypot at a time, which gfortran calls on x86_64, there is no earlier version. */
#include <math.h>

#ifdef __x86_64__
__asm__(".symver hb_first_hypot, hypot@GLIBC_2.2.5");
#else
__asm__(".symver hb_first_hypot, hypot@GLIBC_2.17");
#endif
double hb_first_hypot(double x, double y);
double __wrap_hypot(double x, double y);

double __wrap_hypot(double x, double y)
{
   return hb_first_hypot(x, y);
}

#ifdef __x86_64__
typedef double pair_t __attribute__((vector_size(16)));

pair_t __wrap__ZGVbN2v_tanh(pair_t x);
pair_t __wrap__ZGVbN2v_sinh(pair_t x);
pair_t __wrap__ZGVbN2vv_atan2(pair_t y, pair_t x);
pair_t __wrap__ZGVbN2vv_hypot(pair_t x, pair_t y);

pair_t __wrap__ZGVbN2v_tanh(pair_t x)
{
   return (pair_t){tanh(x[0]), tanh(x[1])};
}

pair_t __wrap__ZGVbN2v_sinh(pair_t x)
{
   return (pair_t){sinh(x[0]), sinh(x[1])};
}

pair_t __wrap__ZGVbN2vv_atan2(pair_t y, pair_t x)
{
   return (pair_t){atan2(y[0], x[0]), atan2(y[1], x[1])};
}

pair_t __wrap__ZGVbN2vv_hypot(pair_t x, pair_t y)
{
   return (pair_t){hb_first_hypot(x[0], y[0]), hb_first_hypot(x[1], y[1])};
}
#endif
