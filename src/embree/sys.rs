//! Functions of Embree's C interface and of the shim. Names are those of the headers.
//!
//! `shim.c` is compiled with the installed headers and checks all that is stated here: if a constant has another value there, or a
//! function another type, the build fails.

use crate::ray::{LANES, Packet};
use std::ffi::{c_char, c_int, c_uint, c_void};
use std::mem::offset_of;

/// An enumeration of C with the constants that are used. Newer libraries may return others, so it is no `enum` of Rust.
macro_rules! enumeration {
    ($(#[$about:meta])* $name:ident { $($(#[$about_value:meta])* $constant:ident = $value:literal,)+ }) => {
        $(#[$about])*
        #[derive(Clone, Copy, PartialEq, Eq)]
        #[repr(transparent)]
        pub struct $name(pub c_uint);

        impl $name {
            $($(#[$about_value])* pub const $constant: $name = $name($value);)+
        }
    };
}

enumeration! {
    /// Error codes.
    RTCError {
        /// Memory ran out.
        RTC_ERROR_OUT_OF_MEMORY = 4,
        /// The processor lacks instructions that Embree needs.
        RTC_ERROR_UNSUPPORTED_CPU = 5,
        /// The progress function ended the commit.
        RTC_ERROR_CANCELLED = 6,
    }
}

enumeration! {
    /// Properties of a device.
    RTCDeviceProperty {
        /// Version of the library: 40303 is 4.3.3.
        RTC_DEVICE_PROPERTY_VERSION = 0,
        /// Whether packets of 4 rays are traced as such.
        RTC_DEVICE_PROPERTY_NATIVE_RAY4_SUPPORTED = 32,
        /// Whether packets of 8 rays are traced as such.
        RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED = 33,
        /// Whether packets of 16 rays are traced as such.
        RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED = 34,
    }
}

enumeration! {
    /// Flags of a scene, joined by "or".
    RTCSceneFlags {
        /// Conservative tests, without cracks between triangles.
        RTC_SCENE_FLAG_ROBUST = 4,
    }
}

enumeration! {
    /// Kinds of geometry.
    RTCGeometryType {
        /// Triangles with shared vertices.
        RTC_GEOMETRY_TYPE_TRIANGLE = 0,
        /// Grids of vertices, two triangles for each four neighbours.
        RTC_GEOMETRY_TYPE_GRID = 2,
        /// Another scene, placed.
        RTC_GEOMETRY_TYPE_INSTANCE = 121,
    }
}

enumeration! {
    /// Types of buffers of a geometry.
    RTCBufferType {
        /// Three numbers of vertices for each triangle.
        RTC_BUFFER_TYPE_INDEX = 0,
        /// Positions of vertices.
        RTC_BUFFER_TYPE_VERTEX = 1,
        /// Positions of grids among the vertices.
        RTC_BUFFER_TYPE_GRID = 8,
    }
}

enumeration! {
    /// Formats of an item of a buffer, and of transforms.
    RTCFormat {
        /// Three `u32`.
        RTC_FORMAT_UINT3 = 0x5003,
        /// Three `f32`.
        RTC_FORMAT_FLOAT3 = 0x9003,
        /// Three rows and four columns of `f32`, column by column.
        RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR = 0x9234,
        /// [`GridPiece`].
        RTC_FORMAT_GRID = 0xA001,
    }
}

/// Opaque type that a handle of Embree points to.
macro_rules! handle {
    ($name:ident, $target:ident) => {
        pub type $name = *mut $target;

        #[repr(C)]
        pub struct $target {
            _private: [u8; 0],
        }
    };
}

handle! { RTCDevice, RTCDeviceTy }
handle! { RTCScene, RTCSceneTy }
handle! { RTCGeometry, RTCGeometryTy }

/// Called at errors with the pointer given for it, a code and a text.
pub type RTCErrorFunction = extern "C" fn(*mut c_void, RTCError, *const c_char);
/// Called with its user pointer before (`false`) or after (`true`) an allocation; the number of bytes is negative for freed memory.
/// `false` makes the allocation fail.
pub type RTCMemoryMonitorFunction = extern "C" fn(*mut c_void, isize, bool) -> bool;
/// Called during a commit with the pointer given for it and the part that is done. `false` ends the commit.
pub type RTCProgressMonitorFunction = extern "C" fn(*mut c_void, f64) -> bool;

// SAFETY: `shim.c` compares these declarations with the headers.
unsafe extern "C" {
    /// Creates a device as a NUL-terminated text describes it; null if that fails.
    pub fn rtcNewDevice(config: *const c_char) -> RTCDevice;
    pub fn rtcReleaseDevice(device: RTCDevice);
    /// Takes the error of this thread; without a device, of the creation of one.
    pub fn rtcGetDeviceError(device: RTCDevice) -> RTCError;
    pub fn rtcGetDeviceProperty(device: RTCDevice, property: RTCDeviceProperty) -> isize;
    /// Sets the callback for errors.
    pub fn rtcSetDeviceErrorFunction(
        device: RTCDevice,
        function: Option<RTCErrorFunction>,
        user: *mut c_void,
    );
    /// Sets the callback for allocations.
    pub fn rtcSetDeviceMemoryMonitorFunction(
        device: RTCDevice,
        function: Option<RTCMemoryMonitorFunction>,
        user: *mut c_void,
    );

    pub fn rtcNewScene(device: RTCDevice) -> RTCScene;
    pub fn rtcReleaseScene(scene: RTCScene);
    pub fn rtcSetSceneFlags(scene: RTCScene, flags: RTCSceneFlags);
    /// Sets the callback for the progress of a commit.
    pub fn rtcSetSceneProgressMonitorFunction(
        scene: RTCScene,
        function: Option<RTCProgressMonitorFunction>,
        user: *mut c_void,
    );
    pub fn rtcCommitScene(scene: RTCScene);
    /// Adds a geometry to a scene, which keeps it, under the given number.
    pub fn rtcAttachGeometryByID(scene: RTCScene, geometry: RTCGeometry, id: c_uint);

    pub fn rtcNewGeometry(device: RTCDevice, kind: RTCGeometryType) -> RTCGeometry;
    pub fn rtcReleaseGeometry(geometry: RTCGeometry);
    /// Says that a geometry is complete.
    pub fn rtcCommitGeometry(geometry: RTCGeometry);
    /// Allocates a buffer of `count` items of `stride` bytes for a geometry, to be filled; null if that fails.
    pub fn rtcSetNewGeometryBuffer(
        geometry: RTCGeometry,
        kind: RTCBufferType,
        slot: c_uint,
        format: RTCFormat,
        stride: usize,
        count: usize,
    ) -> *mut c_void;
    pub fn rtcSetGeometryInstancedScene(geometry: RTCGeometry, scene: RTCScene);
    pub fn rtcSetGeometryTransform(
        geometry: RTCGeometry,
        time_step: c_uint,
        format: RTCFormat,
        transform: *const c_void,
    );
}

// SAFETY: these are the declarations in `shim.h`.
unsafe extern "C" {
    /// `RTC_VERSION` of the headers.
    pub safe fn mrvis_headers_version() -> c_int;
    /// Occlusion query of packets, with a mask of blocked lanes; see `shim.h`.
    pub fn mrvis_occluded(
        scene: RTCScene,
        packets: *const Packet,
        count: usize,
        width: c_int,
        coherent: c_int,
        occluded: *mut u32,
    );
    /// First hits of the lanes of packets; see `shim.h`.
    pub fn mrvis_first_hits(
        scene: RTCScene,
        packets: *const Packet,
        count: usize,
        width: c_int,
        coherent: c_int,
        hits: *mut Hits,
        places: *mut [[f32; LANES]; 2],
    );
}

/// A rectangle of samples of a grid, `RTCGrid`: the first sample, the samples of a row of all the grid, and the columns and rows of the
/// rectangle, at least two of each.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct GridPiece {
    /// Its first sample.
    pub first: u32,
    /// Samples of a row of all the grid.
    pub stride: u32,
    /// Columns and rows of the rectangle.
    pub size: [u16; 2],
}

/// First hits of the segments of a packet. Field order and layout equal those of `mrvis_hits` in `src/embree/shim.h`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Hits {
    /// Triangle index within its geometry per lane; [`Hits::NO_HIT`] without a hit.
    pub triangle: [u32; LANES],
    /// Index of the instance per lane, see [`super::SceneBuilder::add_instance`]; 0 in scenes without instances; undefined without a hit.
    pub instance: [u32; LANES],
    /// Parameter of the hit per lane; undefined without a hit.
    pub t: [f32; LANES],
}

impl Hits {
    /// Triangle index that means "no hit".
    pub const NO_HIT: u32 = u32::MAX;
    /// Bit of [`Hits::triangle`] that the shim sets at hits of a grid's piece.
    pub(super) const PIECE: u32 = 1 << 31;
    /// No hit in any lane.
    pub const NONE: Hits = Hits { triangle: [Self::NO_HIT; LANES], instance: [0; LANES], t: [0.0; LANES] };
}

// The same numbers as in `shim.c`.
const _: () = {
    assert!(size_of::<Packet>() == 576 && align_of::<Packet>() == 64);
    assert!(offset_of!(Packet, origin) == 0);
    assert!(offset_of!(Packet, direction) == 192);
    assert!(offset_of!(Packet, near) == 384);
    assert!(offset_of!(Packet, far) == 448);
    assert!(offset_of!(Packet, active) == 512);
    assert!(size_of::<Hits>() == 192 && align_of::<Hits>() == 4);
    assert!(offset_of!(Hits, triangle) == 0);
    assert!(offset_of!(Hits, instance) == 64);
    assert!(offset_of!(Hits, t) == 128);
    assert!(size_of::<GridPiece>() == 12);
};
