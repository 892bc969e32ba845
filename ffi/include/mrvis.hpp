/* mrvis: C++17 wrapper of mrvis.h. Header only; it owns handles, passes spans on and turns statuses into exceptions. Units, ownership,
 * threads and defaults are those of mrvis.h.
 *
 * SPDX-License-Identifier: MIT OR Apache-2.0
 *
 *   mrv::scene scene = mrv::scene::load("room.obj");
 *   mrv::model model = mrv::model::prepare(scene);
 *   mrv::solution light = model.solve();
 *
 * Handles are cheap to copy: a copy is another reference, a moved-from handle is null. Records are those of mrvis.h with struct_size
 * set. Errors are thrown as mrv::error. With MRVIS_NO_EXCEPTIONS defined nothing is thrown and functions return mrv::result: its
 * status, its message and, on success, its value.
 */
#ifndef MRVIS_HPP
#define MRVIS_HPP

#include "mrvis.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>
#ifndef MRVIS_NO_EXCEPTIONS
#include <exception>
#include <stdexcept>
#endif

namespace mrv {

/* --- constants ------------------------------------------------------------------------------------------------------ */

enum class status : int32_t {
  ok = MRV_OK,
  input = MRV_ERROR_INPUT,
  unsupported = MRV_ERROR_UNSUPPORTED,
  out_of_memory = MRV_ERROR_OUT_OF_MEMORY,
  cancelled = MRV_ERROR_CANCELLED,
  device = MRV_ERROR_DEVICE,
  io = MRV_ERROR_IO,
  internal = MRV_ERROR_INTERNAL
};

enum class detail_level : int32_t {
  standard = MRV_DETAIL_DEFAULT,
  rays = MRV_DETAIL_RAYS,
  clusters = MRV_DETAIL_CLUSTERS,
  optics = MRV_DETAIL_OPTICS
};

enum class cluster_builder : int32_t {
  standard = MRV_BUILDER_DEFAULT,
  grids = MRV_BUILDER_GRIDS,
  kdtree = MRV_BUILDER_KDTREE,
  goldsmith_salmon = MRV_BUILDER_GOLDSMITH_SALMON,
  sah = MRV_BUILDER_SAH
};

enum class engine : int32_t {
  automatic = MRV_ENGINE_AUTOMATIC,
  exact = MRV_ENGINE_EXACT,
  multi_resolution = MRV_ENGINE_MULTI_RESOLUTION,
  average = MRV_ENGINE_AVERAGE
};

enum class method : uint8_t {
  clear = MRV_METHOD_CLEAR,
  covered = MRV_METHOD_COVERED,
  exact = MRV_METHOD_EXACT,
  aggregated = MRV_METHOD_AGGREGATED,
  mixed = MRV_METHOD_MIXED
};

enum class target : int32_t { source = MRV_TARGET_SOURCE, point = MRV_TARGET_POINT };

enum class change : int32_t {
  move = MRV_CHANGE_MOVE,
  add = MRV_CHANGE_ADD,
  remove = MRV_CHANGE_REMOVE,
  show = MRV_CHANGE_SHOW,
  hide = MRV_CHANGE_HIDE
};

enum class grouping : int32_t {
  polygon = MRV_GROUPING_POLYGON,
  object = MRV_GROUPING_OBJECT,
  material = MRV_GROUPING_MATERIAL
};

enum class features : int32_t { both = MRV_FEATURES_BOTH, shadow = MRV_FEATURES_SHADOW };

enum class morphology : int32_t {
  euclid = MRV_MORPHOLOGY_EUCLID,
  paper8 = MRV_MORPHOLOGY_PAPER8,
  paper4 = MRV_MORPHOLOGY_PAPER4
};

enum class name_kind : int32_t {
  object = MRV_NAME_OBJECT,
  material = MRV_NAME_MATERIAL,
  emitter = MRV_NAME_EMITTER,
  repair = MRV_NAME_REPAIR,
  camera = MRV_NAME_CAMERA
};

enum class up_axis : int32_t { automatic = MRV_UP_AUTOMATIC, y = MRV_UP_Y, z = MRV_UP_Z };

enum class channels : int32_t {
  rgb = MRV_CHANNELS_RGB,
  red = MRV_CHANNELS_RED,
  green = MRV_CHANNELS_GREEN,
  blue = MRV_CHANNELS_BLUE
};

enum class power_unit : int32_t {
  watts = MRV_POWER_WATTS,
  lumens = MRV_POWER_LUMENS,
  luminance = MRV_POWER_LUMINANCE
};

/* The name of a status, as "MRV_ERROR_INPUT". */
inline const char *status_name(status value) noexcept { return mrv_status_name(static_cast<mrv_status>(value)); }

/* The number of a constant, for the members of records. */
template <class E>
constexpr std::underlying_type_t<E> number(E value) noexcept {
  return static_cast<std::underlying_type_t<E>>(value);
}

/* --- errors --------------------------------------------------------------------------------------------------------- */

#ifndef MRVIS_NO_EXCEPTIONS

/* What a function of mrvis.h refused or failed at. */
class error : public std::runtime_error {
 public:
  error(mrv::status status, const std::string &message) : std::runtime_error(message), status_(status) {}
  mrv::status status() const noexcept { return status_; }

 private:
  mrv::status status_;
};

template <class T>
using result = T;

#else

/* A status, the message of an error, and the value of a success. */
template <class T>
class [[nodiscard]] result {
 public:
  result(T value) : value_(std::move(value)) {}
  result(mrv::status status, std::string message) : status_(status), message_(std::move(message)) {}
  explicit operator bool() const noexcept { return status_ == mrv::status::ok; }
  mrv::status status() const noexcept { return status_; }
  const std::string &message() const noexcept { return message_; }
  /* The value; a default one after an error. */
  T &value() noexcept { return value_; }
  const T &value() const noexcept { return value_; }

 private:
  mrv::status status_ = mrv::status::ok;
  std::string message_;
  T value_{};
};

template <>
class [[nodiscard]] result<void> {
 public:
  result() = default;
  result(mrv::status status, std::string message) : status_(status), message_(std::move(message)) {}
  explicit operator bool() const noexcept { return status_ == mrv::status::ok; }
  mrv::status status() const noexcept { return status_; }
  const std::string &message() const noexcept { return message_; }

 private:
  mrv::status status_ = mrv::status::ok;
  std::string message_;
};

#endif

namespace detail {

template <class T>
result<T> finish(mrv_status status, T value) {
#ifndef MRVIS_NO_EXCEPTIONS
  if (status != MRV_OK) throw error(static_cast<mrv::status>(status), mrv_error_message());
#else
  if (status != MRV_OK) return {static_cast<mrv::status>(status), mrv_error_message()};
#endif
  return value;
}

inline result<void> finish(mrv_status status) {
#ifndef MRVIS_NO_EXCEPTIONS
  if (status != MRV_OK) throw error(static_cast<mrv::status>(status), mrv_error_message());
#else
  if (status != MRV_OK) return {static_cast<mrv::status>(status), mrv_error_message()};
  return {};
#endif
}

/* Arrays of the caller that do not fit together. */
template <class T>
result<T> incomplete(std::string message) {
#ifndef MRVIS_NO_EXCEPTIONS
  throw error(mrv::status::input, message);
#else
  return {mrv::status::input, std::move(message)};
#endif
}

/* Whether the library speaks the interface of this header: the same first number of the version, before 1.0 also the second, and no
 * older one. Asked once. */
inline bool version_fits() noexcept {
  static const bool fits = [] {
    const int32_t have = mrv_version(), part = MRV_VERSION_MAJOR == 0 ? 100 : 10000;
    return have / part == MRV_VERSION / part && have >= MRV_VERSION;
  }();
  return fits;
}

/* A version as in "0.1.0". */
inline std::string version_text(int32_t version) {
  return std::to_string(version / 10000) + "." + std::to_string(version / 100 % 100) + "." + std::to_string(version % 100);
}

/* A library of another version. */
template <class T>
result<T> other_version() {
  std::string message = "the library is version " + version_text(mrv_version()) + ", the program was compiled for " +
                        version_text(MRV_VERSION) + ": install that version or compile again";
#ifndef MRVIS_NO_EXCEPTIONS
  throw error(mrv::status::unsupported, message);
#else
  return {mrv::status::unsupported, std::move(message)};
#endif
}

/* An array of the caller that is too short for what the call writes or reads. */
template <class T>
result<T> too_short(const char *name, std::size_t have, std::size_t want) {
  return incomplete<T>(std::string("`") + name + "` has " + std::to_string(have) + " entries, must have " + std::to_string(want));
}

/* An array of places or directions that does not have three numbers for each. */
template <class T>
result<T> no_triples(const char *name, std::size_t have) {
  return incomplete<T>(std::string("`") + name + "` has " + std::to_string(have) + " entries, must have x, y and z for each point");
}

}  // namespace detail

/* --- spans ---------------------------------------------------------------------------------------------------------- */

/* A view of an array: of std::vector, std::array, a C array, std::span or anything else with data() and size(). */
template <class T>
class span {
  template <class C>
  using pointer_of = decltype(std::declval<C &>().data());
  template <class C>
  using if_array = std::enable_if_t<!std::is_same_v<std::decay_t<C>, span> &&
                                    std::is_convertible_v<std::remove_pointer_t<pointer_of<C>> (*)[], T (*)[]> &&
                                    std::is_integral_v<decltype(std::declval<C &>().size())>>;

 public:
  constexpr span() noexcept = default;
  constexpr span(T *data, std::size_t size) noexcept : data_(data), size_(size) {}
  template <std::size_t N>
  constexpr span(T (&array)[N]) noexcept : data_(array), size_(N) {}
  template <class C, class = if_array<C>>
  constexpr span(C &&array) noexcept : data_(array.data()), size_(array.size()) {}
  constexpr T *data() const noexcept { return data_; }
  constexpr std::size_t size() const noexcept { return size_; }
  constexpr bool empty() const noexcept { return size_ == 0; }
  constexpr T *begin() const noexcept { return data_; }
  constexpr T *end() const noexcept { return data_ + size_; }
  constexpr T &operator[](std::size_t i) const noexcept { return data_[i]; }

 private:
  T *data_ = nullptr;
  std::size_t size_ = 0;
};

/* --- records -------------------------------------------------------------------------------------------------------- */

/* A record of mrvis.h with all members 0 and its size set. */
template <class R>
struct record : R {
  record() noexcept : R{} { this->struct_size = sizeof(R); }
};

using load_options = record<mrv_load_options>;
using generate_options = record<mrv_generate_options>;
using scene_info = record<mrv_scene_info>;
using mesh = record<mrv_mesh>;
using prepare_options = record<mrv_prepare_options>;
using model_info = record<mrv_model_info>;
using instance = record<mrv_instance>;
using instance_change = record<mrv_instance_change>;
using cost = record<mrv_cost>;
using query = record<mrv_query>;
using answer = record<mrv_answer>;
using solve_options = record<mrv_solve_options>;
using solution_info = record<mrv_solution_info>;
using elements = record<mrv_elements>;
using camera = record<mrv_camera>;
using image_options = record<mrv_image_options>;
using bench_options = record<mrv_bench_options>;
using reference_options = record<mrv_reference_options>;
using fbem_images = record<mrv_fbem_images>;
using lightmap_options = record<mrv_lightmap_options>;
using lightmap_arrays = record<mrv_lightmap_arrays>;
using form_factor_options = record<mrv_form_factor_options>;
using form_factor_arrays = record<mrv_form_factor_arrays>;

/* --- progress ------------------------------------------------------------------------------------------------------- */

/* Called as mrv_progress says; gives whether to go on. What it throws is thrown again by the function that called it. */
using progress = std::function<bool(const char *stage, double done)>;

namespace detail {

/* Passes a std::function through a C callback. */
class progress_call {
 public:
  template <class R>
  progress_call(const progress &wanted, R &options) : wanted_(wanted) {
    if (wanted_) {
      options.progress = &progress_call::call;
      options.user = this;
    }
  }

  /* Throws what the function threw. */
  void rethrow() const {
#ifndef MRVIS_NO_EXCEPTIONS
    if (thrown_) std::rethrow_exception(thrown_);
#endif
  }

 private:
  static int32_t call(void *user, const char *stage, double done) noexcept {
    auto *self = static_cast<progress_call *>(user);
#ifndef MRVIS_NO_EXCEPTIONS
    try {
      return self->wanted_(stage, done) ? 0 : 1;
    } catch (...) {
      self->thrown_ = std::current_exception();
      return 1;
    }
#else
    return self->wanted_(stage, done) ? 0 : 1;
#endif
  }

  const progress &wanted_;
#ifndef MRVIS_NO_EXCEPTIONS
  std::exception_ptr thrown_;
#endif
};

/* --- handles -------------------------------------------------------------------------------------------------------- */

/* Owns one reference, or none. */
template <class T, mrv_status (*Retain)(const T *), void (*Release)(const T *)>
class handle {
 public:
  handle() noexcept = default;
  handle(const handle &other) noexcept : pointer_(other.pointer_) {
    if (pointer_ && Retain(pointer_) != MRV_OK) pointer_ = nullptr; /* after a defect there is nothing to own */
  }
  handle(handle &&other) noexcept : pointer_(std::exchange(other.pointer_, nullptr)) {}
  handle &operator=(handle other) noexcept {
    std::swap(pointer_, other.pointer_);
    return *this;
  }
  ~handle() { Release(pointer_); }

  /* Takes over a reference of mrvis.h. */
  explicit handle(T *reference) noexcept : pointer_(reference) {}
  /* The handle for mrvis.h; the reference stays here. */
  T *get() const noexcept { return pointer_; }
  /* Gives the reference to the caller. */
  T *release() noexcept { return std::exchange(pointer_, nullptr); }
  explicit operator bool() const noexcept { return pointer_ != nullptr; }

 private:
  T *pointer_ = nullptr;
};

}  // namespace detail

/* --- versions ------------------------------------------------------------------------------------------------------- */

/* Version of the library, as MRV_VERSION. */
inline int32_t version() noexcept { return mrv_version(); }

/* Version of the Embree that is loaded. */
inline result<std::string> embree_version() {
  if (!detail::version_fits()) return detail::other_version<std::string>();
  char text[64] = "";
  const mrv_status status = mrv_embree_version(text, sizeof text);
  return detail::finish<std::string>(status, text);
}

/* --- scenes --------------------------------------------------------------------------------------------------------- */

class scene : public detail::handle<mrv_scene, mrv_scene_retain, mrv_scene_release> {
 public:
  using handle::handle;

  static result<scene> load(const std::string &path, const load_options &options = {}) {
    if (!detail::version_fits()) return detail::other_version<scene>();
    mrv_scene *made = nullptr;
    const mrv_status status = mrv_scene_load(path.c_str(), &options, &made);
    return detail::finish(status, scene(made));
  }
  /* `folder`: where files that the scene names are looked for; empty: nowhere. */
  static result<scene> from_memory(span<const unsigned char> data, const std::string &format, const std::string &folder = {},
                                   const load_options &options = {}) {
    if (!detail::version_fits()) return detail::other_version<scene>();
    mrv_scene *made = nullptr;
    const mrv_status status = mrv_scene_from_memory(data.data(), data.size(), format.c_str(),
                                                    folder.empty() ? nullptr : folder.c_str(), &options, &made);
    return detail::finish(status, scene(made));
  }
  static result<scene> generate(const std::string &name, const generate_options &options = {}) {
    if (!detail::version_fits()) return detail::other_version<scene>();
    mrv_scene *made = nullptr;
    const mrv_status status = mrv_scene_generate_with(name.c_str(), &options, &made);
    return detail::finish(status, scene(made));
  }

  /* The same scene without instances, as radiosity and form factors need it. */
  result<scene> flattened(uint64_t max_triangles = 0) const {
    mrv_scene *made = nullptr;
    const mrv_status status = mrv_scene_flatten(get(), max_triangles, &made);
    return detail::finish(status, scene(made));
  }
  /* The same scene below a sky and a sun, as mrv_scene_with_sky; empty texts are left out. */
  result<scene> with_sky(const std::string &sky, const std::string &sun = "", const std::string &place = "",
                         const std::string &time = "") const {
    const auto text = [](const std::string &given) { return given.empty() ? nullptr : given.c_str(); };
    mrv_scene *made = nullptr;
    const mrv_status status = mrv_scene_with_sky(get(), text(sky), text(sun), text(place), text(time), &made);
    return detail::finish(status, scene(made));
  }
  result<scene_info> info() const {
    scene_info info;
    const mrv_status status = mrv_scene_get_info(get(), &info);
    return detail::finish(status, info);
  }
  result<std::string> name(name_kind kind, uint64_t index) const {
    const char *text = "";
    const mrv_status status = mrv_scene_get_name(get(), number(kind), index, &text);
    return detail::finish<std::string>(status, text);
  }
  result<mrv::camera> camera(uint64_t index) const {
    mrv::camera found;
    const mrv_status status = mrv_scene_get_camera(get(), index, &found);
    return detail::finish(status, found);
  }
  result<std::string> unit() const {
    char text[64] = "";
    const mrv_status status = mrv_scene_get_unit(get(), text, sizeof text);
    return detail::finish<std::string>(status, text);
  }
};

class scene_builder
    : public detail::handle<mrv_scene_builder, mrv_scene_builder_retain, mrv_scene_builder_release> {
 public:
  using handle::handle;

  static result<scene_builder> create() {
    if (!detail::version_fits()) return detail::other_version<scene_builder>();
    mrv_scene_builder *made = nullptr;
    const mrv_status status = mrv_scene_builder_create(&made);
    return detail::finish(status, scene_builder(made));
  }

  result<uint32_t> add_material(const std::string &name, const std::array<float, 3> &reflectance = {.5f, .5f, .5f},
                                const std::array<float, 3> &emission = {0, 0, 0}) {
    uint32_t index = 0;
    const mrv_status status =
        mrv_scene_builder_add_material(get(), name.c_str(), reflectance.data(), emission.data(), &index);
    return detail::finish(status, index);
  }
  result<void> add_object(const mrv_mesh &mesh) { return detail::finish(mrv_scene_builder_add_object(get(), &mesh)); }
  result<uint32_t> add_shared_mesh(const mrv_mesh &mesh) {
    uint32_t index = 0;
    const mrv_status status = mrv_scene_builder_add_shared_mesh(get(), &mesh, &index);
    return detail::finish(status, index);
  }
  result<void> add_instance(uint32_t mesh, const std::string &name, const std::array<double, 12> &transform) {
    return detail::finish(mrv_scene_builder_add_instance(get(), mesh, name.c_str(), transform.data()));
  }
  result<scene> finish(const load_options &options = {}) {
    mrv_scene *made = nullptr;
    const mrv_status status = mrv_scene_builder_finish(get(), &options, &made);
    return detail::finish(status, scene(made));
  }
};

/* A mesh of triangles in spans of the caller, which live until it is added. */
inline mesh triangles(const char *name, span<const float> positions, span<const uint32_t> indices, uint32_t material = 0) {
  mesh made;
  made.name = name;
  made.positions = positions.data();
  made.vertex_count = positions.size() / 3;
  made.indices = indices.data();
  made.index_count = indices.size();
  made.material = material;
  return made;
}

/* --- visibility ----------------------------------------------------------------------------------------------------- */

/* Positions of the caller and their number. */
struct positions : mrv_positions {
  std::size_t count = 0;
  /* Whether the spans hold x, y and z of each position; queries refuse others. */
  bool is_whole = true;

  positions() noexcept : mrv_positions{} {}
  /* Packed. */
  positions(span<const float> packed) noexcept
      : mrv_positions{packed.data(), nullptr, nullptr, 0}, count(packed.size() / 3), is_whole(packed.size() % 3 == 0) {}
  positions(span<const std::array<float, 3>> packed) noexcept
      : mrv_positions{packed.empty() ? nullptr : packed.data()->data(), nullptr, nullptr, 0}, count(packed.size()) {}
  /* Interleaved at a stride in bytes. */
  positions(const float *first, std::size_t stride, std::size_t count) noexcept
      : mrv_positions{first, nullptr, nullptr, stride}, count(count) {}
  /* Structure of arrays, packed. */
  positions(span<const float> x, span<const float> y, span<const float> z) noexcept
      : mrv_positions{x.data(), y.data(), z.data(), 0},
        count(x.size()),
        is_whole(x.size() == y.size() && x.size() == z.size()) {}
};

/* A batch in arrays of the caller, which live until it is answered. */
struct segments : record<mrv_segments> {
  /* Number of targets: must be that of origins. */
  std::size_t target_count;
  /* Whether all positions are. */
  bool is_whole;

  /* Segments of one bundle. */
  segments(const positions &from, const positions &to) noexcept
      : target_count(to.count), is_whole(from.is_whole && to.is_whole) {
    origins = from;
    targets = to;
    segment_count = from.count;
  }
  /* Bundles that begin at `bundles`, one entry more than bundles. */
  segments(const positions &from, const positions &to, span<const uint64_t> bundles) noexcept : segments(from, to) {
    offsets = bundles.data();
    bundle_count = bundles.empty() ? 0 : bundles.size() - 1;
  }
  std::size_t bundles() const noexcept { return offsets ? static_cast<std::size_t>(bundle_count) : 1; }
};

/* Where answers go. Empty spans stand for what is not wanted; others have an entry for each bundle, the last one for each segment. */
struct answers {
  span<float> transmittance;
  span<float> lo, hi;
  span<uint8_t> methods;
  span<float> segment_transmittance;
};

/* --- radiosity and form factors ------------------------------------------------------------------------------------- */

class lightmap : public detail::handle<mrv_lightmap, mrv_lightmap_retain, mrv_lightmap_release> {
 public:
  using handle::handle;

  /* The image and the triangles in it; the arrays live as long as this handle. */
  result<lightmap_arrays> arrays() const {
    lightmap_arrays arrays;
    const mrv_status status = mrv_lightmap_get_arrays(get(), &arrays);
    return detail::finish(status, arrays);
  }
};

class solution : public detail::handle<mrv_solution, mrv_solution_retain, mrv_solution_release> {
 public:
  using handle::handle;

  result<solution_info> info() const {
    solution_info info;
    const mrv_status status = mrv_solution_get_info(get(), &info);
    return detail::finish(status, info);
  }
  /* Irradiance at points: packed positions and normals, three numbers each. */
  result<std::vector<double>> irradiance(span<const double> positions, span<const double> normals) const {
    if (positions.size() % 3 != 0) return detail::no_triples<std::vector<double>>("positions", positions.size());
    if (normals.size() != positions.size())
      return detail::too_short<std::vector<double>>("normals", normals.size(), positions.size());
    std::vector<double> found(positions.size());
    const mrv_status status =
        mrv_solution_irradiance(get(), positions.data(), normals.data(), positions.size() / 3, found.data());
    return detail::finish(status, std::move(found));
  }
  /* Copies the elements into arrays of the caller, as mrv_elements says. */
  result<void> copy_elements(const mrv_elements &wanted) const {
    return detail::finish(mrv_solution_get_elements(get(), &wanted));
  }
  /* What a user should know, below info().warnings. */
  result<std::string> warning(uint64_t index) const {
    const char *text = "";
    const mrv_status status = mrv_solution_get_warning(get(), index, &text);
    return detail::finish<std::string>(status, text);
  }
  /* A .vtu, .ply or .glb file. */
  result<void> write(const std::string &path, const progress &progress = {}) const {
    struct callback {
      mrv_progress progress;
      void *user;
    } options = {nullptr, nullptr};
    detail::progress_call call(progress, options);
    const mrv_status status = mrv_solution_write(get(), path.c_str(), options.progress, options.user);
    call.rethrow();
    return detail::finish(status);
  }
  result<std::string> json() const {
    const char *text = "";
    const mrv_status status = mrv_solution_get_json(get(), &text);
    return detail::finish<std::string>(status, text);
  }
  result<std::string> page() const {
    const char *text = "";
    const mrv_status status = mrv_solution_get_page(get(), &text);
    return detail::finish<std::string>(status, text);
  }
  /* A camera that shows much of the scene. */
  result<mrv::camera> camera() const {
    mrv::camera found;
    const mrv_status status = mrv_solution_get_camera(get(), &found);
    return detail::finish(status, found);
  }
  /* Radiance of width x height pixels, three numbers each, row by row from the top. */
  result<void> image(const mrv_camera &camera, image_options options, span<float> radiance,
                     const progress &progress = {}) const {
    detail::progress_call call(progress, options);
    const mrv_status status =
        mrv_solution_image(get(), &camera, &options, radiance.data(), radiance.size());
    call.rethrow();
    return detail::finish(status);
  }
  result<mrv::lightmap> lightmap(lightmap_options options = {}, const progress &progress = {}) const {
    detail::progress_call call(progress, options);
    mrv_lightmap *made = nullptr;
    const mrv_status status = mrv_solution_lightmap(get(), &options, &made);
    mrv::lightmap owned(made);
    call.rethrow();
    return detail::finish(status, std::move(owned));
  }
};

/* The entries of a row of form factors, in arrays of the library. */
struct form_factor_row {
  span<const uint32_t> columns; /* ascending */
  span<const float> values;
};

class form_factors : public detail::handle<mrv_form_factors, mrv_form_factors_retain, mrv_form_factors_release> {
 public:
  using handle::handle;

  /* The matrix; its arrays live as long as this handle. */
  result<form_factor_arrays> arrays() const {
    form_factor_arrays arrays;
    const mrv_status status = mrv_form_factors_get_arrays(get(), &arrays);
    return detail::finish(status, arrays);
  }
  /* One row; its arrays live as long as this handle. */
  result<form_factor_row> row(uint64_t row) const {
    const uint32_t *columns = nullptr;
    const float *values = nullptr;
    std::size_t count = 0;
    const mrv_status status = mrv_form_factors_get_row(get(), row, &columns, &values, &count);
    return detail::finish(status, form_factor_row{{columns, count}, {values, count}});
  }
  result<std::string> name(uint64_t row) const {
    const char *text = "";
    const mrv_status status = mrv_form_factors_get_name(get(), row, &text);
    return detail::finish<std::string>(status, text);
  }
  result<void> write(const std::string &path) const {
    return detail::finish(mrv_form_factors_write(get(), path.c_str()));
  }
};

/* --- measurements --------------------------------------------------------------------------------------------------- */

class bench_report : public detail::handle<mrv_bench_report, mrv_bench_report_retain, mrv_bench_report_release> {
 public:
  using handle::handle;

  result<std::string> json() const {
    const char *text = "";
    const mrv_status status = mrv_bench_report_get_text(get(), &text, nullptr);
    return detail::finish<std::string>(status, text);
  }
  result<std::string> page() const {
    const char *text = "";
    const mrv_status status = mrv_bench_report_get_text(get(), nullptr, &text);
    return detail::finish<std::string>(status, text);
  }
};

/* The feature-based error of an image at each size, and the part of the image in features above it. */
struct fbem_spectrum {
  std::vector<double> errors;
  std::vector<double> masked;
};

inline result<fbem_spectrum> fbem_with_masked(const mrv_fbem_images &images, span<const double> sizes) {
  if (!detail::version_fits()) return detail::other_version<fbem_spectrum>();
  fbem_spectrum found{std::vector<double>(sizes.size()), std::vector<double>(sizes.size())};
  const mrv_status status = mrv_fbem(&images, sizes.data(), sizes.size(), found.errors.data(), found.masked.data());
  return detail::finish(status, std::move(found));
}

/* Irradiance by path tracing and its standard errors, W/m^2, three numbers for each point. */
struct reference_light {
  std::vector<double> irradiance;
  std::vector<double> standard_errors;
};

/* The feature-based error of an image at each size. */
inline result<std::vector<double>> fbem(const mrv_fbem_images &images, span<const double> sizes) {
  if (!detail::version_fits()) return detail::other_version<std::vector<double>>();
  std::vector<double> errors(sizes.size());
  const mrv_status status = mrv_fbem(&images, sizes.data(), sizes.size(), errors.data(), nullptr);
  return detail::finish(status, std::move(errors));
}

/* --- models --------------------------------------------------------------------------------------------------------- */

class model : public detail::handle<mrv_model, mrv_model_retain, mrv_model_release> {
 public:
  using handle::handle;

  static result<model> prepare(const mrv::scene &scene, prepare_options options = {}, const progress &progress = {}) {
    detail::progress_call call(progress, options);
    mrv_model *made = nullptr;
    const mrv_status status = mrv_model_prepare(scene.get(), &options, &made);
    model owned(made);
    call.rethrow();
    return detail::finish(status, std::move(owned));
  }

  result<mrv::scene> scene() const {
    mrv_scene *found = nullptr;
    const mrv_status status = mrv_model_get_scene(get(), &found);
    return detail::finish(status, mrv::scene(found));
  }
  result<model_info> info() const {
    model_info info;
    const mrv_status status = mrv_model_get_info(get(), &info);
    return detail::finish(status, info);
  }
  /* An instance; its name lives as long as this handle. */
  result<mrv::instance> instance(uint64_t index) const {
    mrv::instance found;
    const mrv_status status = mrv_model_get_instance(get(), index, &found);
    return detail::finish(status, found);
  }
  result<model> update(span<const instance_change> changes) const {
    mrv_model *made = nullptr;
    const mrv_status status = mrv_model_update(get(), changes.data(), changes.size(), &made);
    return detail::finish(status, model(made));
  }

  result<mrv::cost> visibility(engine engine, const segments &asked, const answers &wanted) const {
    using found = mrv::cost;
    const std::size_t bundles = asked.bundles();
    const auto count = static_cast<std::size_t>(asked.segment_count);
    if (!asked.is_whole) return detail::incomplete<found>("x, y and z of each position are needed: the spans have other sizes");
    if (asked.target_count != count) return detail::too_short<found>("targets", asked.target_count, count);
    if (wanted.transmittance.size() != bundles)
      return detail::too_short<found>("transmittance", wanted.transmittance.size(), bundles);
    if (!wanted.lo.empty() && wanted.lo.size() != bundles) return detail::too_short<found>("lo", wanted.lo.size(), bundles);
    if (!wanted.hi.empty() && wanted.hi.size() != bundles) return detail::too_short<found>("hi", wanted.hi.size(), bundles);
    if (!wanted.methods.empty() && wanted.methods.size() != bundles)
      return detail::too_short<found>("methods", wanted.methods.size(), bundles);
    if (!wanted.segment_transmittance.empty() && wanted.segment_transmittance.size() != count)
      return detail::too_short<found>("segment_transmittance", wanted.segment_transmittance.size(), count);
    record<mrv_answers> out;
    out.transmittance = wanted.transmittance.data();
    out.lo = wanted.lo.data();
    out.hi = wanted.hi.data();
    out.methods = wanted.methods.data();
    out.segment_transmittance = wanted.segment_transmittance.data();
    mrv::cost cost;
    const mrv_status status = mrv_visibility_answer(get(), number(engine), &asked, &out, &cost);
    return detail::finish(status, cost);
  }
  /* `cost`: what the answer took; may be null. */
  result<mrv::answer> visibility(engine engine, const query &asked, mrv::cost *cost = nullptr) const {
    mrv::answer found;
    const mrv_status status = mrv_visibility_query(get(), number(engine), &asked, &found, cost);
    return detail::finish(status, found);
  }

  result<solution> solve(solve_options options = {}, const progress &progress = {}) const {
    detail::progress_call call(progress, options);
    mrv_solution *made = nullptr;
    const mrv_status status = mrv_model_solve(get(), &options, &made);
    solution owned(made);
    call.rethrow();
    return detail::finish(status, std::move(owned));
  }
  result<bench_report> bench(bench_options options = {}, const progress &progress = {}) const {
    detail::progress_call call(progress, options);
    mrv_bench_report *made = nullptr;
    const mrv_status status = mrv_model_bench(get(), &options, &made);
    bench_report owned(made);
    call.rethrow();
    return detail::finish(status, std::move(owned));
  }
  /* Irradiance at points by path tracing: packed positions and normals, three numbers each. */
  result<reference_light> reference(span<const double> positions, span<const double> normals, reference_options options = {},
                                    const progress &progress = {}) const {
    if (positions.size() % 3 != 0) return detail::no_triples<reference_light>("positions", positions.size());
    if (normals.size() != positions.size())
      return detail::too_short<reference_light>("normals", normals.size(), positions.size());
    detail::progress_call call(progress, options);
    reference_light found{std::vector<double>(positions.size()), std::vector<double>(positions.size())};
    const mrv_status status = mrv_model_reference(get(), positions.data(), normals.data(), positions.size() / 3, &options,
                                                  found.irradiance.data(), found.standard_errors.data());
    call.rethrow();
    return detail::finish(status, std::move(found));
  }
  result<mrv::form_factors> form_factors(form_factor_options options = {}, const progress &progress = {}) const {
    detail::progress_call call(progress, options);
    mrv_form_factors *made = nullptr;
    const mrv_status status = mrv_model_form_factors(get(), &options, &made);
    mrv::form_factors owned(made);
    call.rethrow();
    return detail::finish(status, std::move(owned));
  }
};

}  // namespace mrv

#endif /* MRVIS_HPP */
