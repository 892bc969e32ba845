/* mrvis: visibility and radiosity in scenes full of small detail. C interface.
 *
 * SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * A scene is read, generated or built from arrays; a model is a scene prepared for queries; a model answers visibility, and makes
 * solutions and form factors.
 *
 * Conventions
 *   Units      Lengths are in the unit of the scene (mrv_load_options.unit, metres by default), positions in the coordinates of its
 *              file or arrays. Light is linear RGB: irradiance and radiosity in W/m^2, emission of materials as radiance in
 *              W/(m^2 sr).
 *   Errors     Functions return a status; MRV_OK is 0. Outputs are written only on MRV_OK. mrv_error_message() otherwise names the
 *              argument, its value and the cure. Every function may return MRV_ERROR_INPUT for a required pointer that is NULL, a
 *              wrong record size, or a handle that was released, and MRV_ERROR_OUT_OF_MEMORY. A defect of the library is
 *              MRV_ERROR_INTERNAL and never a crash; later calls with the handles of that call return it too: release them.
 *   Handles    are reference counted. A function that makes one gives the caller one reference. mrv_*_retain adds one, mrv_*_release
 *              gives one back; release(NULL) does nothing. A solution keeps its model alive, a model its scene: any order of release
 *              is right.
 *   Threads    Different handles: from any threads. The same mrv_scene, mrv_model, mrv_solution or mrv_form_factors: from several
 *              threads at once. Release a reference only when no other thread uses that reference any more; a call keeps its
 *              objects alive until it returns. Work runs on threads of the model (mrv_prepare_options.threads); the thread pools and the
 *              floating-point state (rounding, flush to zero, denormals are zero) of the program stay as they are. No result depends on
 *              the number of threads.
 *   Arrays in  are borrowed for the call and not changed. Strides are in bytes from one entry to the next; 0 stands for packed.
 *              Pointers have the alignment of their numbers. An array without entries may be NULL.
 *   Arrays out are the caller's, with room for as many entries as the comment says, and overlap no other array of the call.
 *   Records    begin with struct_size: set it to sizeof the record, all other members to 0, then those that you need; 0 and NULL
 *              stand for the default, and members called `reserved` stay 0. Programs compiled with an older header keep working:
 *              members that they do not have are 0. Records that are filled in need struct_size too.
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

/* --- errors and versions -------------------------------------------------------------------------------------------- */

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

/* Version of the Embree that is loaded, as "4.4.0", into `text`, which has room for `size` bytes with the NUL; longer text is cut.
 * MRV_ERROR_UNSUPPORTED if it is too old. */
mrv_status mrv_embree_version(char *text, size_t size);

/* --- progress ------------------------------------------------------------------------------------------------------- */

/* Called on the thread that called the function, never concurrently: once before the work begins, then at each stage and about every
 * 50 ms. `stage` names what is done and is valid during the call; `done` is the part of the stage that is finished, in [0, 1],
 * negative if unknown. A return value other than 0 cancels: it is not called again, and the work ends within a second, a benchmark at the
 * end of its stage. It must not throw or jump. It may call mrvis, also about the model at work, and release handles: what it asks is
 * done on one thread of its own, whatever the threads of the model. */
typedef int32_t (*mrv_progress)(void *user, const char *stage, double done);

/* --- scenes --------------------------------------------------------------------------------------------------------- */

/* Geometry, materials and emitters. It does not change. */
typedef struct mrv_scene mrv_scene;

#define MRV_UP_AUTOMATIC 0 /* y in glTF; elsewhere as the light and the extents say */
#define MRV_UP_Y 1
#define MRV_UP_Z 2

/* Channels that hold light as the eye weighs it. Luminous quantities of MRV_CHANNELS_RGB are 179 (.2126 R + .7152 G + .0722 B): lx of
 * W/m^2, lm of W, cd/m^2 of W/(m^2 sr). The others hold lumens instead of watts. */
#define MRV_CHANNELS_RGB 0
#define MRV_CHANNELS_RED 1
#define MRV_CHANNELS_GREEN 2
#define MRV_CHANNELS_BLUE 3

#define MRV_POWER_WATTS 0     /* W in each channel */
#define MRV_POWER_LUMENS 1    /* lm */
#define MRV_POWER_LUMINANCE 2 /* cd/m^2 */

/* What files or arrays do not state. */
typedef struct mrv_load_options {
  size_t struct_size;
  const char *unit;            /* unit of length: "m" (default), "dm", "cm", "mm", "km", "in", "ft"; else power counts as in metres */
  const char *const *emitters; /* names of objects, groups or materials that become emitters ... */
  const double *emitter_watts; /* ... and the power that each sends out, at least 0 (0: it emits nothing), in W in each channel or as emitter_units says */
  size_t emitter_count;        /* entries of both */
  int32_t two_sided_emission;  /* other than 0: emissive faces emit from both sides; default: the front alone */
  int32_t sides;               /* 1: all faces bound solids, 2: all are sheets seen from both sides; 0: by connectivity */
  uint32_t threads;            /* threads for reading, at most 1024; 0: one a core */
  uint32_t reserved;
  const int32_t *emitter_units; /* MRV_POWER_... of each emitter; NULL: MRV_POWER_WATTS for all */
  const char *luminaires;      /* placement file in TOML: [[luminaire]] tables of an IES LM-63 or EULUMDAT file, at and aim; NULL: none */
  int32_t up;                  /* MRV_UP_...: upward axis, for skies, automatic cameras and GLB files */
  int32_t channels;            /* MRV_CHANNELS_..., for luminaires and luminous emitters */
  uint64_t max_memory;         /* largest file and largest sum of decoded textures, bytes; 0: four fifths of what is available */
} mrv_load_options;

/* Reads an OBJ, glTF, GLB or PLY file, or a height field in ESRI ASCII, GeoTIFF, PNG or NPZ; the extension of `path` says which.
 * `options` may be NULL. MRV_ERROR_IO if it cannot be read, MRV_ERROR_INPUT if its content cannot be used. */
mrv_status mrv_scene_load(const char *path, const mrv_load_options *options, mrv_scene **scene);

/* Reads a scene from `size` bytes of such a file. `format` is "obj", "gltf", "glb" or "ply"; files that it names (materials, textures,
 * buffers) are looked for from the folder `folder`; without one (NULL) they are MRV_ERROR_INPUT. `options` may be NULL. */
mrv_status mrv_scene_from_memory(const void *data, size_t size, const char *format, const char *folder,
                                 const mrv_load_options *options, mrv_scene **scene);

/* A generated scene: "cornell" (millimetres), "cubes", "cube-groups", "forest", "brick-wall", "louvres", "bookshelf", "desk-room" or
 * "urban-block" (metres). */
mrv_status mrv_scene_generate(const char *name, mrv_scene **scene);

/* Parameters of generated scenes; those that a scene has no use for are ignored. */
typedef struct mrv_generate_options {
  size_t struct_size;
  uint64_t seed;     /* of all random numbers; 0: 1 */
  uint64_t count;    /* cubes, slats, courses of bricks, boards or facets, at most 100 million; 0: as mrv_scene_generate */
  uint64_t trees;    /* trees of the forest, at most 100 million; 0: 100 */
  uint64_t leaves;   /* of each tree, at most 100 million in all; 0: 1000 */
  double light_size; /* edge of the emitter, in the unit of the scene, above 0, at most 1e6; 0: as mrv_scene_generate */
  int32_t trunks;    /* other than 0: trees have trunks */
  uint32_t reserved;
} mrv_generate_options;

/* A generated scene with other parameters. `options` may be NULL. */
mrv_status mrv_scene_generate_with(const char *name, const mrv_generate_options *options, mrv_scene **scene);

/* The same scene without instances: each placed mesh becomes triangles of the scene's own, which radiosity and form factors need. A
 * scene without placed meshes is copied, whatever its size. MRV_ERROR_INPUT if meshes would become more than `max_triangles` (0: 2^31)
 * triangles in all. */
mrv_status mrv_scene_flatten(const mrv_scene *scene, uint64_t max_triangles, mrv_scene **flat);

/* The same scene below a sky and a sun, instead of those that it has; the texts are those of the command's options --sky, --sun, --place and
 * --time, and may be NULL: `sky` "uniform:E", "overcast:E", "cie:N,E", "clear:TURBIDITY", "perez:DNI,DHI", or the name of a map (.exr, .hdr)
 * or of a description (.toml); `sun` "AZIMUTH,ELEVATION:E" or "X,Y,Z:E". Below a sky of a description with `photometric = true`, which is in
 * lux, all other light of the scene must be in lumens and lux. MRV_ERROR_INPUT if the texts are wrong or do not fit together. */
mrv_status mrv_scene_with_sky(const mrv_scene *scene, const char *sky, const char *sun, const char *place, const char *time,
                              mrv_scene **lit);

mrv_status mrv_scene_retain(const mrv_scene *scene);
void mrv_scene_release(const mrv_scene *scene);

/* Numbers of a scene. */
typedef struct mrv_scene_info {
  size_t struct_size;
  uint64_t triangles;      /* triangles that are stored; a mesh that several instances share counts once */
  uint64_t visible;        /* triangles that rays see; a shared mesh counts once an instance */
  uint64_t objects;
  uint64_t materials;
  uint64_t emitters;       /* connected emissive surfaces: the sources of visibility queries */
  uint64_t repairs;        /* repairs and assumptions made while reading */
  uint64_t cameras;        /* perspective cameras of the file */
  double low[3], high[3];  /* corners of the bounding box, scene units */
  double origin[3];        /* the point that coordinates are stored relative to; see mrv_segments.relative_to */
} mrv_scene_info;

mrv_status mrv_scene_get_info(const mrv_scene *scene, mrv_scene_info *info);

#define MRV_NAME_OBJECT 0   /* objects, in the order of the file; not unique in every file */
#define MRV_NAME_MATERIAL 1 /* materials, in the order of the file */
#define MRV_NAME_EMITTER 2  /* emitters; the index is that of the source of light */
#define MRV_NAME_REPAIR 3   /* no names but sentences, one for each kind of repair */
#define MRV_NAME_CAMERA 4   /* cameras; the index is that of mrv_scene_get_camera */

/* A name, by its kind MRV_NAME_... and its index, which is below the number that mrv_scene_info states. Valid until the scene is
 * released. */
mrv_status mrv_scene_get_name(const mrv_scene *scene, int32_t kind, uint64_t index, const char **name);

/* The unit of length as it was given, into `text`, which has room for `size` bytes with the NUL; longer text is cut. */
mrv_status mrv_scene_get_unit(const mrv_scene *scene, char *text, size_t size);

/* --- scenes from arrays --------------------------------------------------------------------------------------------- */

/* Collects materials, then meshes that use them, then instances. From one thread at a time. A call that fails leaves it as it was. */
typedef struct mrv_scene_builder mrv_scene_builder;

/* An empty builder. */
mrv_status mrv_scene_builder_create(mrv_scene_builder **builder);

mrv_status mrv_scene_builder_retain(const mrv_scene_builder *builder);
void mrv_scene_builder_release(const mrv_scene_builder *builder);

/* Adds a material with a unique name; its index counts from 0. `reflectance` of both sides and `emission` of the front have three
 * numbers each, linear RGB: in [0, 1] (above .999 becomes .999), and radiance in W/(m^2 sr), at least 0. NULL stands for .5 and for no
 * emission. `index` may be NULL. */
mrv_status mrv_scene_builder_add_material(mrv_scene_builder *builder, const char *name, const float *reflectance,
                                          const float *emission, uint32_t *index);

/* Triangles, or polygons with any number of corners, also concave. Corners turn counterclockwise as seen from the front. */
typedef struct mrv_mesh {
  size_t struct_size;
  const char *name;               /* unique among objects and instances, or among shared meshes; required */
  const float *positions;         /* x, y, z of each vertex, scene units; this one ... */
  const double *positions_f64;    /* ... or this one */
  size_t position_stride;         /* bytes, a multiple of the size of a number; 0: packed */
  size_t vertex_count;
  const uint32_t *indices;        /* vertices of all polygons, one polygon after the other */
  size_t index_count;
  const uint32_t *polygon_sizes;  /* corners of each polygon, at least 3; NULL: triangles */
  size_t polygon_count;           /* entries of polygon_sizes; not needed for triangles */
  const uint32_t *face_materials; /* material of each polygon; NULL: `material` for all */
  uint32_t material;
  uint32_t reserved;
} mrv_mesh;

/* Adds a mesh as an object of the scene. Its arrays are copied. */
mrv_status mrv_scene_builder_add_object(mrv_scene_builder *builder, const mrv_mesh *mesh);

/* Adds a mesh that instances share; its index counts from 0. Its arrays are copied. It is not seen until it is placed; its materials
 * must not emit. */
mrv_status mrv_scene_builder_add_shared_mesh(mrv_scene_builder *builder, const mrv_mesh *mesh, uint32_t *index);

/* Places a shared mesh. `transform` has twelve numbers: the rows of a 3 by 4 matrix that maps coordinates of the mesh to those of the
 * scene: rotation, reflection, uniform scale (not 0, and equal within 1 %) and translation. No coordinate may exceed 1e12. `name` is unique
 * among objects and instances. */
mrv_status mrv_scene_builder_add_instance(mrv_scene_builder *builder, uint32_t mesh, const char *name,
                                          const double *transform);

/* Makes the scene: merges vertices, triangulates, checks and repairs as for a file. `options` may be NULL. The builder is empty
 * afterwards, also if there is no usable face or an emitter of the options does not exist (MRV_ERROR_INPUT). */
mrv_status mrv_scene_builder_finish(mrv_scene_builder *builder, const mrv_load_options *options, mrv_scene **scene);

/* --- models: scenes prepared for queries ---------------------------------------------------------------------------- */

/* A scene with everything that queries share. It does not change: mrv_model_update makes another. */
typedef struct mrv_model mrv_model;

#define MRV_DETAIL_DEFAULT 0  /* MRV_DETAIL_OPTICS */
#define MRV_DETAIL_RAYS 1     /* exact visibility, form factors */
#define MRV_DETAIL_CLUSTERS 2 /* also radiosity with exact visibility */
#define MRV_DETAIL_OPTICS 3   /* also multi-resolution and average visibility */

/* Algorithms that build clusters. They change what is averaged and how fast, not what exact visibility answers. */
#define MRV_BUILDER_DEFAULT 0         /* MRV_BUILDER_GRIDS */
#define MRV_BUILDER_GRIDS 1           /* hierarchy of uniform grids */
#define MRV_BUILDER_KDTREE 2          /* k-d tree */
#define MRV_BUILDER_GOLDSMITH_SALMON 3 /* bounding boxes by insertion */
#define MRV_BUILDER_SAH 4             /* divisions into two by the surface area heuristic */

typedef struct mrv_prepare_options {
  size_t struct_size;
  int32_t detail;        /* MRV_DETAIL_...: how much is prepared */
  uint32_t threads;      /* threads of the preparation and of all queries, at most 1024; 0: one a core */
  const char *cache;     /* folder for measured clusters, which makes the next preparation faster; NULL: no files */
  mrv_progress progress; /* may be NULL; if it cancels, MRV_ERROR_CANCELLED is returned */
  void *user;            /* first argument of `progress` */
  int32_t builder;       /* MRV_BUILDER_...: how clusters are built */
  uint32_t reserved;
} mrv_prepare_options;

/* Prepares a scene. `options` may be NULL. MRV_ERROR_UNSUPPORTED if Embree is too old, MRV_ERROR_DEVICE if it fails. */
mrv_status mrv_model_prepare(const mrv_scene *scene, const mrv_prepare_options *options, mrv_model **model);

mrv_status mrv_model_retain(const mrv_model *model);
void mrv_model_release(const mrv_model *model);

/* The scene of a model, a new reference. */
mrv_status mrv_model_get_scene(const mrv_model *model, mrv_scene **scene);

typedef struct mrv_model_info {
  size_t struct_size;
  uint64_t sources;       /* sources of light: targets of queries */
  uint64_t instances;     /* instances, removed ones included; the first holds the scene's own triangles */
  uint64_t revision;      /* number of updates since the preparation */
  uint64_t embree_bytes;  /* bytes that Embree reports for its structures */
  double embree_seconds;  /* seconds of building Embree's structures, */
  double cluster_seconds; /* ... of building clusters, 0 if they were read, */
  double optics_seconds;  /* ... of measuring their optics, 0 if they were read, */
  double cache_seconds;   /* ... and of files in the folder `cache` */
  int32_t detail;         /* MRV_DETAIL_... */
  int32_t from_cache;     /* other than 0: the clusters were read from the folder `cache` */
} mrv_model_info;

mrv_status mrv_model_get_info(const mrv_model *model, mrv_model_info *info);

/* --- instances ------------------------------------------------------------------------------------------------------ */

#define MRV_MATERIAL_KEEP (-1) /* the materials of the mesh */

/* A placed mesh. Transforms are the rows of a 3 by 4 matrix that maps coordinates of the mesh to those of the model, which are scene
 * units relative to mrv_scene_info.origin: rotation, reflection, uniform scale and translation. */
typedef struct mrv_instance {
  size_t struct_size;
  const char *name;     /* valid until the model is released */
  double transform[12];
  int64_t material;     /* index of the material that replaces those of the mesh, or MRV_MATERIAL_KEEP */
  uint32_t mesh;        /* 0: the scene's own triangles; meshes that instances share follow */
  int32_t visible;      /* other than 0: blocks and receives light */
  int32_t removed;      /* other than 0: it was removed; indices of others did not change */
  uint32_t reserved;
} mrv_instance;

/* The instance with this index, below mrv_model_info.instances. */
mrv_status mrv_model_get_instance(const mrv_model *model, uint64_t index, mrv_instance *instance);

#define MRV_CHANGE_MOVE 1   /* to `transform` */
#define MRV_CHANGE_ADD 2    /* a new instance after all others: `mesh`, `transform`, `name`, `material` */
#define MRV_CHANGE_REMOVE 3
#define MRV_CHANGE_SHOW 4
#define MRV_CHANGE_HIDE 5

/* A change of one instance. */
typedef struct mrv_instance_change {
  size_t struct_size;   /* all changes of a call have the same */
  int32_t kind;         /* MRV_CHANGE_... */
  uint32_t instance;    /* index of the instance, at least 1: the scene's own triangles stay; not for MRV_CHANGE_ADD */
  double transform[12]; /* for MRV_CHANGE_MOVE and MRV_CHANGE_ADD */
  const char *name;     /* for MRV_CHANGE_ADD; NULL: "instance" */
  int64_t material;     /* for MRV_CHANGE_ADD: index of a material that does not emit, or MRV_MATERIAL_KEEP */
  uint32_t mesh;        /* for MRV_CHANGE_ADD, at least 1 */
  uint32_t reserved;
} mrv_instance_change;

/* The model after `count` changes, in their order: a new handle. It shares with `model`, which stays as it is, all that did not
 * change, and answers as a model that is prepared afresh. */
mrv_status mrv_model_update(const mrv_model *model, const mrv_instance_change *changes, size_t count, mrv_model **updated);

/* --- visibility ----------------------------------------------------------------------------------------------------- */

#define MRV_ENGINE_AUTOMATIC 0        /* multi-resolution where a feature size is given and it is expected to be faster, else exact */
#define MRV_ENGINE_EXACT 1            /* one Embree ray a segment */
#define MRV_ENGINE_MULTI_RESOLUTION 2 /* averages clusters without shadow features of the feature size; needs MRV_DETAIL_OPTICS */
#define MRV_ENGINE_AVERAGE 3          /* extinction alone, without rays: an estimate; needs the same */

#define MRV_METHOD_CLEAR 0      /* no geometry lies between the ends */
#define MRV_METHOD_COVERED 1    /* one triangle covers the whole emitter, or it turns away */
#define MRV_METHOD_EXACT 2      /* triangles were tested */
#define MRV_METHOD_AGGREGATED 3 /* clusters were averaged */
#define MRV_METHOD_MIXED 4      /* both */

/* As a stride: all positions are the first one, interleaved or in three arrays. */
#define MRV_SAME_POSITION SIZE_MAX

/* Positions in arrays of the caller; nothing is copied. Interleaved: set x, leave y and z NULL; x, y, z of a position follow each
 * other. Structure of arrays: set all three; the stride is that of each. */
typedef struct mrv_positions {
  const float *x;
  const float *y;
  const float *z;
  size_t stride; /* bytes, a multiple of 4; 0: packed */
} mrv_positions;

/* A batch: segment i runs from origins[i], the receiver, to targets[i], the emitter. Bundle k holds the segments offsets[k] to
 * offsets[k + 1] - 1, at most 1048576; they should begin at one place and end at one emitter. Bundles with neighbouring receivers
 * should follow each other: that is faster. */
typedef struct mrv_segments {
  size_t struct_size;
  mrv_positions origins;
  mrv_positions targets;
  uint64_t segment_count;
  const uint64_t *offsets;    /* bundle_count + 1 ascending numbers, the first 0, the last segment_count; NULL: one bundle */
  uint64_t bundle_count;      /* not needed without offsets */
  const float *feature_sizes; /* for each bundle, scene units, above 0: features of shadows of at least this size are resolved;
                                 NULL: `feature_size` for all */
  const float *emitter_sizes; /* for each bundle: smallest width of the emitter as seen from the receiver, scene units, at least 0;
                                 smaller than true is safe; NULL: `emitter_size` for all */
  float feature_size;         /* 0: none; only the engines exact and automatic answer without */
  float emitter_size;         /* 0: a point */
  double relative_to[3];      /* the point of the scene that positions are relative to; with mrv_scene_info.origin they are used
                                 without rounding */
} mrv_segments;

/* Where answers go; NULL for what is not wanted. */
typedef struct mrv_answers {
  size_t struct_size;
  float *transmittance;         /* for each bundle, in [0, 1]: mean of its segments, 1 without segments; required */
  float *lo;                    /* for each bundle: the interval that holds it with 95 % probability; both or none */
  float *hi;
  uint8_t *methods;             /* for each bundle, MRV_METHOD_... */
  float *segment_transmittance; /* for each segment; cluster engines then answer groups of 16 segments, with wider intervals */
} mrv_answers;

/* What answers took: numbers of segments, but for `nodes`. */
typedef struct mrv_cost {
  size_t struct_size;
  uint64_t segments;
  uint64_t nodes;       /* visited nodes of the cluster tree, each counted once a bundle */
  uint64_t exact_rays;  /* segments for which triangles were tested */
  uint64_t handed_over; /* segments that multi-resolution visibility gave to Embree after all */
  uint64_t aggregated;  /* segments whose answer contains an averaged cluster */
  uint64_t certified;   /* segments of bundles whose answer is certain without rays */
} mrv_cost;

/* Answers a batch on the threads of the model, or on the calling thread if the model has one thread. Several threads may ask one model
 * at once. No memory is taken once the model's buffers are large enough. `cost` may be NULL. MRV_ERROR_INPUT names
 * the array and the index if a position is not finite, a segment has no length, offsets do not ascend or a size is out of range. */
mrv_status mrv_visibility_answer(const mrv_model *model, int32_t engine, const mrv_segments *segments,
                                 const mrv_answers *answers, mrv_cost *cost);

#define MRV_TARGET_SOURCE 0 /* the source of light `source` */
#define MRV_TARGET_POINT 1  /* the position `point`, by one segment */

/* A single query: how much of the light that would arrive at a point of a surface gets through. */
typedef struct mrv_query {
  size_t struct_size;
  double position[3];
  double normal[3];    /* of the side that receives light, of any length above 0 */
  double point[3];     /* for MRV_TARGET_POINT */
  uint64_t source;     /* for MRV_TARGET_SOURCE: index of the emitter */
  int32_t target;      /* MRV_TARGET_... */
  float feature_size;  /* scene units; 0: none, the answer is exact */
  uint32_t rays;       /* segments to a source, at most 65536; 0: 64 */
  uint32_t seed;       /* of the points on the source; 0: 1 */
} mrv_query;

typedef struct mrv_answer {
  size_t struct_size;
  float transmittance; /* in [0, 1] */
  float lo, hi;        /* the interval that holds it with 95 % probability */
  int32_t method;      /* MRV_METHOD_... */
} mrv_answer;

/* Answers a single query on the thread of the caller. What lies below the horizon of the normal counts as hidden; cosines and
 * distances do not count. `cost` may be NULL. */
mrv_status mrv_visibility_query(const mrv_model *model, int32_t engine, const mrv_query *query, mrv_answer *answer,
                                mrv_cost *cost);

/* --- radiosity ------------------------------------------------------------------------------------------------------ */

/* The light in a model. It does not change. */
typedef struct mrv_solution mrv_solution;

typedef struct mrv_solve_options {
  size_t struct_size;
  int32_t engine;        /* MRV_ENGINE_EXACT (also for 0), _MULTI_RESOLUTION or _AVERAGE; others than exact need MRV_DETAIL_OPTICS */
  int32_t direct_only;   /* other than 0: irradiance at points is direct light alone */
  double error;          /* target error relative to the mean irradiance, above 0; 0: .02 */
  double target_error;   /* rays are added until this RMS error of the elements, relative to the mean irradiance, is reached, above 0;
                            0: none */
  double min_area;       /* smallest element as a part of the scene's area, in [1e-9, 1]; 0: 2e-5 */
  double max_seconds;    /* limit of this call, about, above 0; the preparation of the model does not count; 0: none */
  uint64_t max_links;    /* number of links (72 bytes each) at which refinement ends, at most 2^30; 0: ten million */
  uint64_t seed;         /* of all random numbers; 0: 1 */
  double feature_size;   /* scene units, for engines other than exact; 0: the diameter of each receiver */
  const char *const *feature_size_names; /* names of objects, groups or materials with feature sizes of their own ... */
  const float *feature_sizes;            /* ... and these, scene units, above 0 */
  size_t feature_size_count;             /* entries of both */
  const char *const *importance;         /* names of objects, groups or materials whose light matters; none: all alike */
  size_t importance_count;
  mrv_progress progress; /* may be NULL; if it cancels, the solution is the consistent one reached so far */
  void *user;            /* first argument of `progress` */
  uint32_t audit;        /* elements whose error bars are checked by independent paths, at most 1048576; 0: 200 */
  int32_t no_audit;      /* other than 0: none are */
  uint32_t light_rays;   /* shadow rays from a point to an emitter that is partly visible, at most 65536, and up to 16 times as
                            many where little of much light passes; 0: by the error */
  uint32_t gather_rays;  /* rays from a point that gather reflected light, at most 1048576; 0: by the error */
} mrv_solve_options;

/* Computes the light, on the threads of the model. `options` may be NULL. MRV_ERROR_INPUT for a model with placed meshes:
 * see mrv_scene_flatten. */
mrv_status mrv_model_solve(const mrv_model *model, const mrv_solve_options *options, mrv_solution **solution);

mrv_status mrv_solution_retain(const mrv_solution *solution);
void mrv_solution_release(const mrv_solution *solution);

typedef struct mrv_solution_info {
  size_t struct_size;
  uint64_t vertices;         /* corners of the elements */
  uint64_t elements;         /* constant pieces of lit sides of surfaces */
  double mean_irradiance[3]; /* of all surfaces, W/m^2 */
  double error_estimate;     /* RMS error of the elements relative to the mean irradiance; negative if unknown */
  int32_t interrupted;       /* other than 0: `progress` cancelled before the error was reached */
  uint32_t reserved;
  uint64_t warnings;         /* sentences of mrv_solution_get_warning */
} mrv_solution_info;

mrv_status mrv_solution_get_info(const mrv_solution *solution, mrv_solution_info *info);

/* What a user should know: repairs of the scene, limits that were reached. `index` is below mrv_solution_info.warnings. Valid until the
 * solution is released. */
mrv_status mrv_solution_get_warning(const mrv_solution *solution, uint64_t index, const char **text);

/* Irradiance at points of surfaces: positions (at most 1e12 from mrv_scene_info.origin) and normals (of the side that receives light, of
 * any length above 0) of `count` points, three doubles each, packed; three doubles each in `irradiance`, W/m^2. Runs on the threads of
 * the model. Points are copied once, into 24 bytes each; all in all 240 bytes a point must be free, else
 * MRV_ERROR_OUT_OF_MEMORY. */
mrv_status mrv_solution_irradiance(const mrv_solution *solution, const double *positions, const double *normals,
                                   size_t count, double *irradiance);

/* The elements in arrays of the caller; NULL for what is not wanted. */
typedef struct mrv_elements {
  size_t struct_size;
  uint64_t vertex_capacity;  /* vertices that `positions` has room for, at least mrv_solution_info.vertices */
  uint64_t element_capacity; /* elements that each other array has room for, at least mrv_solution_info.elements */
  double *positions;         /* three numbers for each vertex, scene units */
  uint32_t *corners;         /* four vertices for each element, counterclockwise from its lit side; a triangle repeats the third */
  float *irradiance;         /* three numbers for each element, W/m^2 */
  float *radiosity;          /* three, W/m^2, emission included */
  float *error;              /* three: standard uncertainty of the irradiance, W/m^2 */
  float *reflectance;        /* three, in [0, 1) */
  double *area;              /* scene units squared */
  uint32_t *triangle;        /* a triangle of the scene that the element lies on */
  uint32_t *object;          /* index of the object */
  uint32_t *material;        /* index of the material */
  uint8_t *front;            /* 1: on the front of its face, 0: on the back */
  float *exitance;           /* three, W/m^2: what the element emits by itself */
} mrv_elements;

/* Copies the elements and their corners. */
mrv_status mrv_solution_get_elements(const mrv_solution *solution, const mrv_elements *elements);

/* The record of the solution as JSON, as the file solution.json: options, times, energy, error estimate, warnings. Valid until the
 * solution is released. */
mrv_status mrv_solution_get_json(const mrv_solution *solution, const char **json);

/* Writes the solution to a file, completely or not at all. The extension says the format: vtu (elements with all fields, for ParaView),
 * ply or glb (smooth meshes with colours). `progress` may be NULL; if it cancels before the file is complete, the call returns
 * MRV_ERROR_CANCELLED, and an older file of that name stays. */
mrv_status mrv_solution_write(const mrv_solution *solution, const char *path, mrv_progress progress, void *user);

/* One HTML page about the solution with pictures and tables, which refers to no other file. Valid until the solution is released. */
mrv_status mrv_solution_get_page(const mrv_solution *solution, const char **html);

/* --- images --------------------------------------------------------------------------------------------------------- */

/* A pinhole camera. */
typedef struct mrv_camera {
  size_t struct_size;
  double eye[3];    /* position, as `target` at most 1e12 from mrv_scene_info.origin */
  double target[3]; /* a point in the middle of the picture, other than `eye` */
  double up[3];     /* direction that is upwards in the picture, of any length above 0 */
  double angle;     /* angle of view from top to bottom, degrees, above 0 and below 180 */
} mrv_camera;

/* The camera of the file with this index, below mrv_scene_info.cameras. */
mrv_status mrv_scene_get_camera(const mrv_scene *scene, uint64_t index, mrv_camera *camera);

/* A camera that shows much of the scene: from inside at eye height if it is enclosed. */
mrv_status mrv_solution_get_camera(const mrv_solution *solution, mrv_camera *camera);

typedef struct mrv_image_options {
  size_t struct_size;
  uint32_t width;        /* columns and rows, at most 16384 each and 33554432 pixels; both 0: 800 and 600 */
  uint32_t height;
  int32_t gather;        /* other than 0: final gathering for every pixel instead of interpolation: slower and sharper */
  int32_t look_inside;   /* other than 0: surfaces are transparent from sides that no light can reach, as the outside of a closed room */
  mrv_progress progress; /* may be NULL; if it cancels, MRV_ERROR_CANCELLED is returned */
  void *user;            /* first argument of `progress` */
} mrv_image_options;

/* The radiance that a camera sees, W/(m^2 sr), linear RGB: three numbers for each pixel, row by row from the top, black where it sees
 * no side that light can reach. `size` is the number of floats in `radiance`: 3 width height. `options` may be NULL. The work takes 96 bytes a pixel, 156
 * with `gather`; MRV_ERROR_OUT_OF_MEMORY before it begins if they are not left. */
mrv_status mrv_solution_image(const mrv_solution *solution, const mrv_camera *camera, const mrv_image_options *options,
                              float *radiance, size_t size);

/* Irradiance of all surfaces in one image, and where each triangle lies in it. It does not change. */
typedef struct mrv_lightmap mrv_lightmap;

typedef struct mrv_lightmap_options {
  size_t struct_size;
  uint64_t texels;       /* approximate number of texels, at most 67108864; 0: 1048576 */
  mrv_progress progress; /* may be NULL; if it cancels, MRV_ERROR_CANCELLED is returned */
  void *user;            /* first argument of `progress` */
} mrv_lightmap_options;

/* Draws a lightmap: in the texture coordinates of the file, which show fronts alone, if they are suitable, else with a chart for each
 * plane. `options` may be NULL. */
mrv_status mrv_solution_lightmap(const mrv_solution *solution, const mrv_lightmap_options *options,
                                 mrv_lightmap **lightmap);

mrv_status mrv_lightmap_retain(const mrv_lightmap *lightmap);
void mrv_lightmap_release(const mrv_lightmap *lightmap);

/* The lightmap in arrays of the library, packed, valid until it is released. */
typedef struct mrv_lightmap_arrays {
  size_t struct_size;
  uint64_t width;
  uint64_t height;
  const float *irradiance; /* three numbers for each texel, W/m^2, row by row from the top */
  uint64_t vertices;
  const double *positions; /* three numbers for each vertex, scene units */
  uint64_t triangles;
  const uint32_t *corners; /* three vertices for each triangle, counterclockwise from its lit side */
  const float *texcoords;  /* six numbers for each triangle: u, v of its corners, from the lower left corner of the image */
  const char *note;        /* why the texture coordinates are not those of the file; NULL if they are */
} mrv_lightmap_arrays;

mrv_status mrv_lightmap_get_arrays(const mrv_lightmap *lightmap, mrv_lightmap_arrays *arrays);

/* --- form factors --------------------------------------------------------------------------------------------------- */

/* Form factors F(from, to): the part of what the front of one surface sends out that arrives at the front of another, with what
 * stands between them. A sparse matrix that does not change; area(from) F(from, to) is symmetric. */
typedef struct mrv_form_factors mrv_form_factors;

#define MRV_GROUPING_POLYGON 0 /* a row for each polygon */
#define MRV_GROUPING_OBJECT 1
#define MRV_GROUPING_MATERIAL 2

typedef struct mrv_form_factor_options {
  size_t struct_size;
  int32_t grouping;      /* MRV_GROUPING_...: rows and columns */
  int32_t no_closure;    /* other than 0: rows from which nothing escapes are not adjusted to the sum 1 */
  uint32_t rays;         /* rays of every polygon that look for what it sees, at most 1048576; 0: 2048, more for few polygons */
  uint32_t pair_rays;    /* largest number of rays between two polygons, 4 to 4194304; 0: 256, more for few polygons */
  uint64_t max_bytes;    /* a matrix that could be larger is MRV_ERROR_OUT_OF_MEMORY; 0: four fifths of what is available */
  uint64_t seed;         /* of all random numbers; 0: 1 */
  mrv_progress progress; /* may be NULL; if it cancels, MRV_ERROR_CANCELLED is returned */
  void *user;            /* first argument of `progress` */
} mrv_form_factor_options;

/* Computes the form factors of a scene by exact rays, on the threads of the model. `options` may be NULL. MRV_ERROR_INPUT for a model
 * with placed meshes: see mrv_scene_flatten. */
mrv_status mrv_model_form_factors(const mrv_model *model, const mrv_form_factor_options *options,
                                  mrv_form_factors **factors);

mrv_status mrv_form_factors_retain(const mrv_form_factors *factors);
void mrv_form_factors_release(const mrv_form_factors *factors);

/* The matrix by rows, in arrays of the library that are valid until the factors are released. */
typedef struct mrv_form_factor_arrays {
  size_t struct_size;
  uint64_t rows;           /* also the number of columns */
  uint64_t entries;        /* factors other than 0 */
  const uint64_t *offsets; /* rows + 1: row i has the entries offsets[i] to offsets[i + 1] - 1 */
  const uint32_t *columns; /* of each entry; ascending in a row */
  const float *values;     /* of each entry: the form factor, in [0, 1] */
  const double *areas;     /* of each row, scene units squared; 0 for objects and materials without faces */
  const float *escaped;    /* of each row: the part that leaves the scene, in [0, 1] */
  const float *lost;       /* of each row: the part that falls on back sides, in [0, 1] */
  uint64_t rays;           /* rays that were traced */
  double row_sum_error;    /* mean of |row sum + escaped + lost - 1| over the polygons, before closure */
  double closed_row_sum_error; /* the same over those from which nothing escapes, after closure; 0 without such polygons */
} mrv_form_factor_arrays;

mrv_status mrv_form_factors_get_arrays(const mrv_form_factors *factors, mrv_form_factor_arrays *arrays);

/* One row: `columns` and `values` point to `count` entries and are valid until the factors are released. */
mrv_status mrv_form_factors_get_row(const mrv_form_factors *factors, uint64_t row, const uint32_t **columns,
                                    const float **values, size_t *count);

/* The name of a row, that of its object or material; empty for polygons. Valid until the factors are released. */
mrv_status mrv_form_factors_get_name(const mrv_form_factors *factors, uint64_t row, const char **name);

/* Writes the matrix to a file, completely or not at all. The extension says the format: npz (as scipy.sparse.load_npz reads it),
 * csv (from, to, factor) or mtx (Matrix Market). */
mrv_status mrv_form_factors_write(const mrv_form_factors *factors, const char *path);

/* --- measurements --------------------------------------------------------------------------------------------------- */

/* Time and error of exact and of multi-resolution visibility, as `mrvis bench` measures them. It does not change. */
typedef struct mrv_bench_report mrv_bench_report;

typedef struct mrv_bench_options {
  size_t struct_size;
  uint64_t points;               /* receiver points, at most 100 million; 0: 20000 */
  uint32_t rays;                 /* segments from a point to an emitter, at most 65536; 0: 16 */
  uint32_t reference_rays;       /* the same in the reference, at most 65536; 0: 1024 */
  const double *feature_sizes;   /* scene units, above 0; none: four, from 2 texels of the images to 1/5 of the largest */
  size_t feature_size_count;
  const char *const *receivers;  /* names of objects, groups or materials for shadow images; none: the largest flat surfaces */
  size_t receiver_count;
  double audit;                  /* part of the bundles on which exact rays check the stated intervals, in [0, 1]; 0: .05 */
  uint64_t seed;                 /* of all random numbers; 0: 1 */
  uint32_t threads;              /* threads of the timed sections, at most 1024; 0: 1 */
  int32_t no_audit;              /* other than 0: no audit */
  mrv_progress progress;         /* may be NULL; if it cancels, MRV_ERROR_CANCELLED is returned after the stage */
  void *user;                    /* first argument of `progress` */
  uint64_t max_memory;           /* largest memory of the results, bytes; 0: four fifths of what is available */
} mrv_bench_options;

/* Measures a model with MRV_DETAIL_OPTICS, in seconds to minutes; nothing else should run meanwhile. `options` may be NULL. */
mrv_status mrv_model_bench(const mrv_model *model, const mrv_bench_options *options, mrv_bench_report **report);

mrv_status mrv_bench_report_retain(const mrv_bench_report *report);
void mrv_bench_report_release(const mrv_bench_report *report);

/* The report as JSON and as an HTML page that refers to no other file, valid until it is released. NULL for what is not wanted. */
mrv_status mrv_bench_report_get_text(const mrv_bench_report *report, const char **json, const char **html);

typedef struct mrv_reference_options {
  size_t struct_size;
  uint64_t seed;         /* of all random numbers; 0: 1 */
  uint32_t samples;      /* paths for each point, at least 2; 0: 1024 */
  int32_t direct_only;   /* other than 0: direct light alone, without reflections */
  mrv_progress progress; /* may be NULL; if it cancels, MRV_ERROR_CANCELLED is returned */
  void *user;            /* first argument of `progress` */
} mrv_reference_options;

/* Irradiance at points by path tracing, a reference that shares nothing with solutions: positions and normals as for
 * mrv_solution_irradiance; three doubles for each point in `irradiance` and, unless that is NULL, in `standard_errors`, W/m^2.
 * `options` may be NULL. */
mrv_status mrv_model_reference(const mrv_model *model, const double *positions, const double *normals, size_t count,
                               const mrv_reference_options *options, double *irradiance, double *standard_errors);

#define MRV_FEATURES_BOTH 0   /* shadows and lit regions are features */
#define MRV_FEATURES_SHADOW 1 /* shadows alone, as in the paper */

#define MRV_MORPHOLOGY_EUCLID 0 /* sizes by the largest disc in a feature */
#define MRV_MORPHOLOGY_PAPER8 1 /* by erosions with 8 neighbours, as in the program of the paper */
#define MRV_MORPHOLOGY_PAPER4 2 /* by erosions with 4 neighbours, as in the definition of the paper */

/* Two images of one quantity, such as a visible fraction: one float for each texel, row by row from the top left, packed. */
typedef struct mrv_fbem_images {
  size_t struct_size;
  const float *reference;
  const float *approximation;
  uint64_t width;
  uint64_t height;
  double texel;            /* side of a texel, scene units; 0: 1, sizes are then in texels */
  double exponent;         /* of the norm, at least 1; 0: 2 */
  float white;             /* value of an unoccluded texel, above 0; 0: 1 */
  float threshold;         /* smallest relative darkening that is shadow, in [0, 1); 0: that of `mrvis fbem` */
  int32_t features;        /* MRV_FEATURES_... */
  int32_t morphology;      /* MRV_MORPHOLOGY_... */
  int32_t unmasked_filter; /* other than 0: averages outside of features leave features out */
  uint32_t reserved;
} mrv_fbem_images;

/* The feature-based error of an image at `count` feature sizes (scene units, at least 0): features larger than the size are compared
 * texel by texel, the rest on average. An error for each size, in units of the image, and, unless `masked` is NULL, the part of the
 * image in such features, in [0, 1]. Runs on the calling thread. Images are not copied; about 128 bytes a texel must be free, else
 * MRV_ERROR_OUT_OF_MEMORY. */
mrv_status mrv_fbem(const mrv_fbem_images *images, const double *sizes, size_t count, double *errors, double *masked);

#ifdef __cplusplus
}
#endif

#endif /* MRVIS_H */
