/* What the programs that misuse nhbm.h share: a check, valid objects, and all functions on a model. */
#ifndef MISUSE_STEPS_H
#define MISUSE_STEPS_H

#include "nhbm.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHECK(what) do { if (!(what)) return __LINE__; } while (0)
#define SAYS(words) (strstr(nhbm_get_last_error(), words) != NULL) /* the last error */

int cubic(const nhbm_law_samples_t *s);     /* a law */
nhbm_law_info_t valid_info(void);
int read_input(nhbm_model *m);
int set_number(nhbm_model *m, const char *path, double value);
nhbm_model *solved(void);                   /* a model that has solved; NULL if it could not be made */
bool is_usable(nhbm_model *model);          /* whether the motion has the value that a new model finds */

/* Index of the first function, other than nhbm_destroy of NULL, that does not return a status with a message; -1 if all do. */
int first_other(nhbm_model *model, int status);

#endif
