/* mrvis: visibility and radiosity in scenes full of small detail. C interface.
 *
 * SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * Conventions
 *   Units      Lengths are in the unit of the scene (mrv_load_options.unit, metres by default). Light is linear RGB: irradiance and
 *              radiosity in W/m^2, emission of materials as radiance in W/(m^2 sr).
 *   Errors     Every function returns a status; MRV_OK is 0. Outputs are written only on MRV_OK. mrv_error_message() describes the
 *              last error of the calling thread. A NULL where a pointer is required is MRV_ERROR_INPUT, never a crash. A defect inside
 *              the library is MRV_ERROR_INTERNAL; the handles of the call may then be used no more than to release them.
 *   Handles    are reference counted. A function that makes one gives the caller one reference. mrv_*_retain adds one, mrv_*_release
 *              gives one back; release(NULL) does nothing. A solution keeps its model alive, a model its scene: any order of release
 *              is right.
 *   Threads    Different handles: from any threads. The same mrv_scene, mrv_model, mrv_solution or mrv_form_factors: from several
 *              threads at once, also release. The same mrv_scene_builder: from one thread at a time.
 *              Work runs on the threads of its model (mrv_prepare_options.threads). The caller's own thread pools and its
 *              floating-point state (flush to zero, denormals are zero) stay as they are.
 *   Arrays in  are borrowed for the call. Strides are in bytes from one element to the next; 0 stands for packed. Positions need the
 *              alignment of their numbers.
 *   Arrays out are the caller's, with room for as many entries as the comment says.
 *   Records    begin with struct_size: set it to sizeof the record and all other members to 0, then those that you need; 0 and NULL
 *              stand for the default. Programs compiled with an older header keep working: members that they do not have are 0.
 *   Strings    are UTF-8, ended by NUL.
 */
#ifndef MRVIS_H
#define MRVIS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Version of this header. Before 1.0.0 the interface may change with the second number. */
#define MRV_VERSION_MAJOR 0
#define MRV_VERSION_MINOR 1
#define MRV_VERSION_PATCH 0
/* One number, for comparisons: 10000 major + 100 minor + patch. */
#define MRV_VERSION (10000 * MRV_VERSION_MAJOR + 100 * MRV_VERSION_MINOR + MRV_VERSION_PATCH)

/* --- errors --------------------------------------------------------------------------------------------------------- */

typedef int32_t mrv_status;
#define MRV_OK 0
#define MRV_ERROR_INPUT 1         /* a scene, a file's content or an argument is wrong: change it */
#define MRV_ERROR_UNSUPPORTED 2   /* this machine, the installed Embree or this version cannot do it */
#define MRV_ERROR_OUT_OF_MEMORY 3 /* ask for less */
#define MRV_ERROR_CANCELLED 4     /* the caller's callback stopped the work before there was a result */
#define MRV_ERROR_DEVICE 5        /* Embree failed */
#define MRV_ERROR_IO 6            /* a file or folder could not be read or written */
#define MRV_ERROR_INTERNAL 7      /* a defect of mrvis: please report it */

/* The message of the last call on this thread that did not return MRV_OK; empty before that. Valid until the next such call on
 * this thread. */
const char *mrv_error_message(void);

/* The name of a status, as "MRV_ERROR_INPUT"; "unknown" for other numbers. Valid for ever. */
const char *mrv_status_name(mrv_status status);

/* Version of the library, as MRV_VERSION. */
int32_t mrv_version(void);

/* Version of the Embree that is loaded, as "4.4.0", and of the library, into `text`, which has room for `size` bytes; longer text is
 * cut. */
mrv_status mrv_embree_version(char *text, size_t size);

/* --- scenes --------------------------------------------------------------------------------------------------------- */

typedef struct mrv_scene mrv_scene;

/* What a file or arrays do not state. */
typedef struct mrv_load_options {
  size_t struct_size;
  const char *unit;               /* unit of length: "m" (default), "dm", "cm", "mm", "km", "in", "ft" */
  const char *const *emitters;    /* names of objects, groups or materials that become emitters ... */
  const double *emitter_watts;    /* ... and the power that each sends out in each channel, W */
  size_t emitter_count;
  int32_t two_sided_emission;     /* other than 0: emissive faces emit from both sides; default: the front alone */
  int32_t sides;                  /* 1: all faces bound solids, 2: all are sheets seen from both sides; 0: by connectivity */
  uint32_t threads;               /* threads for reading; 0: one a core */
  uint32_t reserved;              /* 0 */
} mrv_load_options;

/* Reads an OBJ, glTF, GLB or PLY file. `options` may be NULL. */
mrv_status mrv_scene_load(const char *path, const mrv_load_options *options, mrv_scene **scene);

/* A generated scene, as `mrvis generate` makes it: "cornell", "cubes", "forest", ... */
mrv_status mrv_scene_generate(const char *name, mrv_scene **scene);

mrv_status mrv_scene_retain(const mrv_scene *scene);
void mrv_scene_release(const mrv_scene *scene);

#ifdef __cplusplus
}
#endif

#endif /* MRVIS_H */
