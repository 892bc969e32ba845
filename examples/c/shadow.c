/* The shadow of a ball: how much of a lamp each point of the ground sees, as an image in the terminal. */
#include <math.h>
#include <mrvis.h>
#include <stdio.h>
#include <stdlib.h>

enum { WIDTH = 64, HEIGHT = 32, RAYS = 64, STEPS = 48 };
static float from[WIDTH * HEIGHT * RAYS][3], to[WIDTH * HEIGHT * RAYS][3], seen[WIDTH * HEIGHT];
static uint64_t offsets[WIDTH * HEIGHT + 1];
static float ball[STEPS * (STEPS + 1)][3];
static uint32_t faces[STEPS * STEPS * 6];

static void check(mrv_status status) {
  if (status == MRV_OK) return;
  fprintf(stderr, "%s: %s\n", mrv_status_name(status), mrv_error_message());
  exit(1);
}

int main(void) {
  for (uint32_t i = 0, face = 0; i < STEPS * (STEPS + 1); i++) {
    const double pi = acos(-1), u = 2 * pi * (i % STEPS) / STEPS, v = pi * (i / STEPS) / STEPS;
    ball[i][0] = (float)(cos(u) * sin(v)), ball[i][1] = (float)(sin(u) * sin(v)), ball[i][2] = (float)(2 - cos(v));
    if (i >= STEPS * STEPS) continue;
    const uint32_t next = i % STEPS == STEPS - 1 ? i + 1 - STEPS : i + 1;
    const uint32_t corners[6] = {i, next, next + STEPS, i, next + STEPS, i + STEPS};
    for (int k = 0; k < 6; k++) faces[face++] = corners[k];
  }
  mrv_scene_builder *builder;
  mrv_scene *scene;
  mrv_model *model;
  mrv_mesh mesh = {.struct_size = sizeof mesh, .name = "ball", .positions = ball[0], .vertex_count = STEPS * (STEPS + 1),
                   .indices = faces, .index_count = STEPS * STEPS * 6};
  check(mrv_scene_builder_create(&builder));
  check(mrv_scene_builder_add_material(builder, "white", NULL, NULL, &mesh.material));
  check(mrv_scene_builder_add_object(builder, &mesh));
  check(mrv_scene_builder_finish(builder, NULL, &scene));
  check(mrv_model_prepare(scene, NULL, &model));

  /* A bundle of segments from each point to a grid on the lamp, a square of 1 m at a height of 5 m. */
  for (int i = 0; i < WIDTH * HEIGHT * RAYS; i++) {
    const int point = i / RAYS, ray = i % RAYS;
    from[i][0] = (float)(point % WIDTH) / 8 - 4, from[i][1] = 4 - (float)(point / WIDTH) / 4, from[i][2] = 0;
    to[i][0] = ((float)(ray % 8) + .5f) / 8 - .5f, to[i][1] = ((float)(ray / 8) + .5f) / 8 - .5f, to[i][2] = 5;
    if (ray == 0) offsets[point + 1] = (uint64_t)(point + 1) * RAYS;
  }
  const mrv_segments segments = {.struct_size = sizeof segments, .origins = {.x = from[0]}, .targets = {.x = to[0]},
                                 .segment_count = WIDTH * HEIGHT * RAYS, .offsets = offsets, .bundle_count = WIDTH * HEIGHT};
  const mrv_answers answers = {.struct_size = sizeof answers, .transmittance = seen};
  check(mrv_visibility_answer(model, MRV_ENGINE_EXACT, &segments, &answers, NULL));
  for (int i = 0; i < WIDTH * HEIGHT; i++) {
    putchar("#%*+=-:. "[(int)(8 * seen[i])]);
    if (i % WIDTH == WIDTH - 1) putchar('\n');
  }

  mrv_model_release(model);
  mrv_scene_release(scene);
  mrv_scene_builder_release(builder);
  return 0;
}
