/* A host that links the static library of mrvis beside another one in Rust. */
#include "check.h"

uint64_t other_sum(uint64_t count);
int32_t other_catches(void);

int main(void) {
  CHECK(other_sum(1000) == 499500 && other_catches() == 1);
  mrv_model *model = prepared(2);
  CHECK(seen(model, MRV_ENGINE_MULTI_RESOLUTION, 0.1f) > 0 && light(model) > 0);
  mrv_model_release(model);
  CHECK(other_sum(1000) == 499500 && other_catches() == 1);
  puts("done");
  return 0;
}
