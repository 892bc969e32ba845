/* Two models with one and two threads of their own, asked at once by two threads of the host: the same answers, bit by bit. */
#define _POSIX_C_SOURCE 200809L
#include <pthread.h>

#include "check.h"

static void *work(void *user) {
  const mrv_model *model = *(mrv_model **)user;
  static double results[2];
  static int next = 0;
  double sum = light(model);
  for (int i = 0; i < 30; i++) sum += seen(model, MRV_ENGINE_MULTI_RESOLUTION, 0.1f);
  double *place = &results[__atomic_fetch_add(&next, 1, __ATOMIC_SEQ_CST)];
  *place = sum;
  return place;
}

int main(void) {
  mrv_model *models[2] = {prepared(1), prepared(2)};
  pthread_t threads[2];
  void *results[2];
  for (int i = 0; i < 2; i++) CHECK(pthread_create(&threads[i], NULL, work, &models[i]) == 0);
  for (int i = 0; i < 2; i++) CHECK(pthread_join(threads[i], &results[i]) == 0);
  CHECK(memcmp(results[0], results[1], sizeof(double)) == 0);
  for (int i = 0; i < 2; i++) mrv_model_release(models[i]);
  puts("done");
  return 0;
}
