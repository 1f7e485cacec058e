/* Source: user documentation for CVODE 6.4. */
#include "hb_cvode.h"

#include <stddef.h>

#ifdef HB_WITHOUT_CVODE

int hb_has_cvode(void) { return 0; }

hb_cvode_t *hb_cvode_new(const hb_cvode_problem_t *problem, const int *directions, double **y, int *flag)
{
   (void)problem;
   (void)directions;
   *y = NULL;
   *flag = -1;
   return NULL;
}

int hb_cvode_restart(hb_cvode_t *self, double t)
{
   (void)self;
   (void)t;
   return -1;
}

int hb_cvode_advance(hb_cvode_t *self, double t_end, double *t, int *found)
{
   (void)self;
   (void)t_end;
   (void)t;
   (void)found;
   return -1;
}

void hb_cvode_delete(hb_cvode_t *self) { (void)self; }

#else

#include <cvode/cvode.h>
#include <limits.h>
#include <nvector/nvector_serial.h>
#include <stdlib.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

struct hb_cvode_t {
   hb_cvode_problem_t problem;
   SUNContext context;
   void *memory;
   N_Vector y;
   SUNNonlinearSolver nonlinear_solver;
   SUNLinearSolver linear_solver;
   SUNMatrix matrix;
};

int hb_has_cvode(void) { return 1; }

static int call_rhs(double t, N_Vector y, N_Vector dydt, void *data)
{
   const hb_cvode_problem_t *problem = data;
   return problem->rhs(t, N_VGetArrayPointer(y), N_VGetArrayPointer(dydt), problem->data);
}

static int call_events(double t, N_Vector y, double *values, void *data)
{
   const hb_cvode_problem_t *problem = data;
   return problem->events(t, N_VGetArrayPointer(y), values, problem->data);
}

static int call_weights(N_Vector y, N_Vector values, void *data)
{
   const hb_cvode_problem_t *problem = data;
   return problem->weights(0.0, N_VGetArrayPointer(y), N_VGetArrayPointer(values), problem->data);
}

static void tell(int code, const char *module, const char *function, char *message, void *data)
{
   const hb_cvode_problem_t *problem = data;
   (void)module;
   (void)function;
   problem->tell(message, code == CV_WARNING, problem->data);
}

static int prepare(hb_cvode_t *self, const int *directions)
{
   hb_cvode_problem_t *problem = &self->problem;
   int flag = CVodeSetErrHandlerFn(self->memory, tell, problem);
   if (flag == CV_SUCCESS) flag = CVodeInit(self->memory, call_rhs, 0.0, self->y);
   if (flag == CV_SUCCESS) flag = CVodeSetUserData(self->memory, problem);
   if (flag == CV_SUCCESS) flag = CVodeWFtolerances(self->memory, call_weights);
   if (flag == CV_SUCCESS) flag = CVodeSetMaxNumSteps(self->memory, LONG_MAX);
   if (flag != CV_SUCCESS) return flag;
   if (problem->is_stiff) {
      self->matrix = SUNDenseMatrix(problem->n, problem->n, self->context);
      if (self->matrix != NULL) self->linear_solver = SUNLinSol_Dense(self->y, self->matrix, self->context);
      flag = CVodeSetLinearSolver(self->memory, self->linear_solver, self->matrix);
   } else {
      self->nonlinear_solver = SUNNonlinSol_FixedPoint(self->y, 0, self->context);
      flag = CVodeSetNonlinearSolver(self->memory, self->nonlinear_solver);
   }
   if (flag == CV_SUCCESS) flag = CVodeSetNoInactiveRootWarn(self->memory);
   if (flag != CV_SUCCESS || problem->n_events == 0) return flag;
   flag = CVodeRootInit(self->memory, problem->n_events, call_events);
   if (flag == CV_SUCCESS) flag = CVodeSetRootDirection(self->memory, (int *)directions);
   return flag;
}

hb_cvode_t *hb_cvode_new(const hb_cvode_problem_t *problem, const int *directions, double **y, int *flag)
{
   hb_cvode_t *self = calloc(1, sizeof *self);
   *y = NULL;
   *flag = 0;
   if (self == NULL) return NULL;
   self->problem = *problem;
   if (SUNContext_Create(NULL, &self->context) == 0) self->y = N_VNew_Serial(problem->n, self->context);
   if (self->y != NULL) self->memory = CVodeCreate(problem->is_stiff ? CV_BDF : CV_ADAMS, self->context);
   if (self->memory == NULL) {
      hb_cvode_delete(self);
      return NULL;
   }
   N_VConst(0.0, self->y);
   *y = N_VGetArrayPointer(self->y);
   *flag = prepare(self, directions);
   return self;
}

int hb_cvode_restart(hb_cvode_t *self, double t) { return CVodeReInit(self->memory, t, self->y); }

int hb_cvode_advance(hb_cvode_t *self, double t_end, double *t, int *found)
{
   int flag = CVode(self->memory, t_end, self->y, t, CV_NORMAL);
   if (flag < 0) return flag;
   if (flag != CV_ROOT_RETURN) return 0;
   CVodeGetRootInfo(self->memory, found);
   return 1;
}

void hb_cvode_delete(hb_cvode_t *self)
{
   if (self == NULL) return;
   if (self->memory != NULL) CVodeFree(&self->memory);
   if (self->linear_solver != NULL) SUNLinSolFree(self->linear_solver);
   if (self->nonlinear_solver != NULL) SUNNonlinSolFree(self->nonlinear_solver);
   if (self->matrix != NULL) SUNMatDestroy(self->matrix);
   if (self->y != NULL) N_VDestroy(self->y);
   if (self->context != NULL) SUNContext_Free(&self->context);
   free(self);
}

#endif
