#define _POSIX_C_SOURCE 200809L /* for strdup */
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "../laws/nhbm_user_law.h"

typedef struct registered_law {
   char *name;
   nhbm_law_info_t info;
   nhbm_law_evaluate_2_function evaluate;
   struct registered_law *next;
} registered_law_t;

static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static registered_law_t *laws;

/* Address of the pointer to the law of a name, or of the null pointer after the last one if there is none. */
static registered_law_t **find(const char *name)
{
   registered_law_t **link = &laws;
   while (*link && strcmp((*link)->name, name) != 0) link = &(*link)->next;
   return link;
}

/* Returns 0, or 1 if no law has this name. */
static int remove_law(const char *name)
{
   registered_law_t **link = find(name), *law = *link;
   if (!law) return 1;
   *link = law->next;
   free(law->name);
   free(law);
   return 0;
}

/* Registers a law, replacing one of the same name. Returns 0, or 1 if memory is insufficient. */
int hb_register_law(const char *name, const nhbm_law_info_t *info, nhbm_law_evaluate_2_function evaluate)
{
   registered_law_t *law = calloc(1, sizeof *law);
   char *copy = malloc(strlen(name) + 1);
   if (!law || !copy) {
      free(law);
      free(copy);
      return 1;
   }
   law->name = strcpy(copy, name);
   law->info = *info;
   law->evaluate = evaluate;
   (void)pthread_mutex_lock(&mutex);
   (void)remove_law(name);
   law->next = laws;
   laws = law;
   (void)pthread_mutex_unlock(&mutex);
   return 0;
}

/* Returns 0, or 1 if no law has this name. */
int hb_unregister_law(const char *name)
{
   int result;
   (void)pthread_mutex_lock(&mutex);
   result = remove_law(name);
   (void)pthread_mutex_unlock(&mutex);
   return result;
}

/* Whether the program has registered a law of that name; copies its data. */
int hb_find_registered_law(const char *name, nhbm_law_info_t *info, nhbm_law_evaluate_2_function *evaluate)
{
   const registered_law_t *law;
   (void)pthread_mutex_lock(&mutex);
   law = *find(name);
   if (law) {
      *info = law->info;
      *evaluate = law->evaluate;
   }
   (void)pthread_mutex_unlock(&mutex);
   return law != NULL;
}
