/* A host that forks before it uses the library: parent and child compute the same. */
#define _POSIX_C_SOURCE 200809L
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"

static double work(void) {
  mrv_model *model = prepared(2);
  double sum = seen(model, MRV_ENGINE_AUTOMATIC, 0.2f) + light(model);
  mrv_model_release(model);
  return sum;
}

int main(void) {
  int pipes[2], status = 0;
  double here, there = 0;
  CHECK(mrv_version() == MRV_VERSION && pipe(pipes) == 0);
  pid_t child = fork();
  CHECK(child >= 0);
  if (child == 0) {
    there = work();
    _exit(write(pipes[1], &there, sizeof there) == sizeof there ? 0 : 1);
  }
  here = work();
  CHECK(read(pipes[0], &there, sizeof there) == sizeof there);
  CHECK(waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0);
  CHECK(here > 0 && memcmp(&here, &there, sizeof here) == 0);
  puts("done");
  return 0;
}
