#define _POSIX_C_SOURCE 200809L /* for strdup */
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "../laws/nhbm_user_law.h"

typedef struct given_law {
   char *name;
   nhbm_law_info_t info;
   nhbm_law_evaluate_2_function evaluate;
   struct given_law *next;
} given_law_t;

static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static given_law_t *laws;

/* Address of the pointer to the law of a name, or of the null pointer after the last one if there is none. */
static given_law_t **place_of(const char *name)
{
   given_law_t **place = &laws;
   while (*place && strcmp((*place)->name, name) != 0) place = &(*place)->next;
   return place;
}

static void forget(const char *name)
{
   given_law_t **place = place_of(name), *law = *place;
   if (!law) return;
   *place = law->next;
   free(law->name);
   free(law);
}

int hb_give_law(const char *name, const nhbm_law_info_t *info, nhbm_law_evaluate_2_function evaluate)
{
   given_law_t *law = calloc(1, sizeof *law);
   char *copy = malloc(strlen(name) + 1);
   if (!law || !copy || info->api_version != NHBM_USER_LAW_API_2 || !evaluate) {
      free(law);
      free(copy);
      return 1;
   }
   law->name = strcpy(copy, name);
   law->info = *info;
   law->evaluate = evaluate;
   (void)pthread_mutex_lock(&mutex);
   forget(name);
   law->next = laws;
   laws = law;
   (void)pthread_mutex_unlock(&mutex);
   return 0;
}

void hb_forget_law(const char *name)
{
   (void)pthread_mutex_lock(&mutex);
   forget(name);
   (void)pthread_mutex_unlock(&mutex);
}

/* Whether the program has registered a law of that name; copies its data. */
int hb_find_given_law(const char *name, nhbm_law_info_t *info, nhbm_law_evaluate_2_function *evaluate)
{
   const given_law_t *law;
   (void)pthread_mutex_lock(&mutex);
   law = *place_of(name);
   if (law) {
      *info = law->info;
      *evaluate = law->evaluate;
   }
   (void)pthread_mutex_unlock(&mutex);
   return law != NULL;
}
