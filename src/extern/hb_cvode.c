/* Source: user documentation for CVODE 6.4 and 7.1. Differences between SUNDIALS 6 and 7 are in this file alone. */
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
   const hb_cvode_t *self = data;
   return self->problem.rhs(t, N_VGetArrayPointer(y), N_VGetArrayPointer(dydt), self->problem.data);
}

static int call_events(double t, N_Vector y, double *values, void *data)
{
   const hb_cvode_t *self = data;
   return self->problem.events(t, N_VGetArrayPointer(y), values, self->problem.data);
}

/* CVode evaluates the weights before each step but the first, where the current step is the one that it takes next. Version 6 gives the
   warning about a step that no longer changes the time to the handler of errors, version 7 to its log, where it cannot be read. */
static void report_stagnation(hb_cvode_t *self)
{
   long n_steps = 0;
   double t = 0.0, step = 0.0;
   if (CVodeGetNumSteps(self->memory, &n_steps) != CV_SUCCESS || n_steps == 0) return;
   if (CVodeGetCurrentTime(self->memory, &t) != CV_SUCCESS || CVodeGetCurrentStep(self->memory, &step) != CV_SUCCESS) return;
   if (t + step == t) self->problem.tell("the step no longer changes the time", 1, self->problem.data);
}

static int call_weights(N_Vector y, N_Vector values, void *data)
{
   hb_cvode_t *self = data;
   report_stagnation(self);
   return self->problem.weights(0.0, N_VGetArrayPointer(y), N_VGetArrayPointer(values), self->problem.data);
}

#if SUNDIALS_VERSION_MAJOR < 7

static int create_context(SUNContext *context) { return SUNContext_Create(NULL, context); }

static void tell(int code, const char *module, const char *function, char *message, void *data)
{
   const hb_cvode_t *self = data;
   (void)module;
   (void)function;
   self->problem.tell(message, code == CV_WARNING, self->problem.data);
}

static int set_error_handler(hb_cvode_t *self) { return CVodeSetErrHandlerFn(self->memory, tell, self); }

#else

static int create_context(SUNContext *context) { return SUNContext_Create(SUN_COMM_NULL, context); }

static void tell(int line, const char *function, const char *file, const char *message, SUNErrCode code, void *data, SUNContext context)
{
   const hb_cvode_t *self = data;
   (void)line;
   (void)function;
   (void)file;
   (void)context;
   self->problem.tell(message != NULL ? message : SUNGetErrMsg(code), code == CV_WARNING, self->problem.data);
}

/* In place of the handler that prints: each of a stack of them is called. */
static int set_error_handler(hb_cvode_t *self)
{
   int flag = SUNContext_ClearErrHandlers(self->context);
   return flag != 0 ? flag : SUNContext_PushErrHandler(self->context, tell, self);
}

#endif

static int prepare(hb_cvode_t *self, const int *directions)
{
   const hb_cvode_problem_t *problem = &self->problem;
   int flag = set_error_handler(self);
   if (flag == CV_SUCCESS) flag = CVodeInit(self->memory, call_rhs, 0.0, self->y);
   if (flag == CV_SUCCESS) flag = CVodeSetUserData(self->memory, self);
   if (flag == CV_SUCCESS) flag = CVodeWFtolerances(self->memory, call_weights);
   if (flag == CV_SUCCESS) flag = CVodeSetMaxNumSteps(self->memory, LONG_MAX);
   if (flag == CV_SUCCESS) flag = CVodeSetMaxHnilWarns(self->memory, -1);
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
   if (create_context(&self->context) == 0) self->y = N_VNew_Serial(problem->n, self->context);
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
