/* CVODE of SUNDIALS as four calls on arrays. Built with HB_WITHOUT_CVODE there is none, and hb_cvode_new makes nothing. */
#ifndef HB_CVODE_H
#define HB_CVODE_H

/* Ordinary differential equations, and how they are integrated. Each function returns 0, or by its sign whether a shorter step may
   help (above 0) or nothing does (below). */
typedef struct {
   int (*rhs)(double t, const double *y, double *dydt, void *data);
   int (*events)(double t, const double *y, double *values, void *data);
   int (*weights)(double t, const double *y, double *values, void *data); /* of the norm of errors */
   void (*tell)(const char *message, int is_warning, void *data);
   void *data;
   int n, n_events;
   int is_stiff; /* backward differences with a dense Jacobian; else Adams methods with functional iteration */
} hb_cvode_problem_t;

typedef struct hb_cvode_t hb_cvode_t;

int hb_has_cvode(void);

/* An integrator for hb_cvode_delete, NULL where memory is short; `flag` is not 0 where CVODE refuses. `directions` of the events: -1
   falling, 1 rising, 0 both. `y` is where the state stands, which may be changed before hb_cvode_restart. */
hb_cvode_t *hb_cvode_new(const hb_cvode_problem_t *problem, const int *directions, double **y, int *flag);

/* Starts anew from y at time t; nothing of the past is used. Returns 0, or not. */
int hb_cvode_restart(hb_cvode_t *self, double t);

/* Integrates to `t_end`, or to an event before it. Returns 1 at an event, with the directions found, 0 at the end, below 0 where it
   fails. */
int hb_cvode_advance(hb_cvode_t *self, double t_end, double *t, int *found);

/* Frees everything; NULL is nothing. */
void hb_cvode_delete(hb_cvode_t *self);

#endif
