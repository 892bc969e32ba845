/* The C side of boundary.rs: one batch through mrv_visibility_answer. */
#include <string.h>

#include "mrvis.h"

typedef mrv_status (*answer_function)(const mrv_model *, int32_t, const mrv_segments *, const mrv_answers *, mrv_cost *);

int32_t ask(answer_function answer, const mrv_model *model, int32_t engine, const float *origins, const float *targets,
            const uint64_t *offsets, uint64_t bundles, float feature_size, float *transmittance, float *lo, float *hi,
            uint8_t *methods) {
  mrv_cost cost = {sizeof cost, 0, 0, 0, 0, 0, 0};
  mrv_answers answers = {sizeof answers, transmittance, lo, hi, methods, NULL};
  mrv_segments segments;
  memset(&segments, 0, sizeof segments);
  segments.struct_size = sizeof segments;
  segments.origins.x = origins;
  segments.targets.x = targets;
  segments.segment_count = offsets[bundles];
  segments.offsets = offsets;
  segments.bundle_count = bundles;
  segments.feature_size = feature_size;
  return answer(model, engine, &segments, &answers, &cost);
}
