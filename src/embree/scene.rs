//! Building a scene, committing it, and occlusion queries.

use super::bindings as sys;
use super::device::Device;
use crate::error::{Error, Result};
use crate::ray::{LANES, Occluder, Packet};
use glam::Vec3;
use std::sync::Arc;

/// Build quality of the acceleration structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// Morton order: fastest build.
    Low,
    /// Binned surface-area heuristic.
    Medium,
    /// Spatial splits; Embree ignores it in robust scenes.
    High,
}

/// How a scene is built.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Conservative box and edge tests: no cracks between neighbours, 8 to 20 % slower.
    pub robust: bool,
    /// Half the memory at about two thirds of the speed.
    pub compact: bool,
    /// Build quality.
    pub quality: Quality,
}

impl Default for Options {
    /// Robust, medium quality: single and packet queries agree there.
    fn default() -> Self {
        Options { robust: true, compact: false, quality: Quality::Medium }
    }
}

/// How packets are traced: rays a call and whether Embree may assume that they stay together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Traversal {
    /// Rays a call: 1, 4, 8 or 16. Other values count as 1.
    pub width: usize,
    /// Packet traversal for coherent rays; without effect at width 1.
    pub coherent: bool,
}

impl Traversal {
    /// The name in reports: `occluded16`, with `+coherent` where it applies.
    pub fn name(self) -> String {
        format!("occluded{}{}", self.width, if self.coherent { "+coherent" } else { "" })
    }
}

/// A scene under construction.
pub struct SceneBuilder {
    handle: Handle,
    triangles: usize,
}

/// An immutable scene that can be traced from any number of threads. Cheap to clone: clones share the geometry.
#[derive(Clone)]
pub struct CommittedScene {
    handle: Arc<Handle>,
    triangles: usize,
    traversal: Traversal,
}

struct Handle {
    raw: sys::RTCScene,
    device: Device,
}

// SAFETY: a scene handle may move between threads; building calls need `&mut`, queries on a committed scene are
// thread-safe (Embree manual, "Thread safety").
unsafe impl Send for Handle {}
// SAFETY: only `CommittedScene` shares it, and offers nothing but ray queries.
unsafe impl Sync for Handle {}

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: released once, by its only owner; the device outlives it through `self.device`.
        unsafe { sys::rtcReleaseScene(self.raw) }
    }
}

impl SceneBuilder {
    /// An empty scene. Flags are set before anything else: Embree ignores them after a commit.
    ///
    /// # Errors
    /// If Embree refuses.
    pub fn new(device: &Device, options: Options) -> Result<SceneBuilder> {
        use sys::{RTCBuildQuality as Q, RTCSceneFlags as F};
        let mut flags = F::RTC_SCENE_FLAG_NONE;
        if options.robust {
            flags |= F::RTC_SCENE_FLAG_ROBUST;
        }
        if options.compact {
            flags |= F::RTC_SCENE_FLAG_COMPACT;
        }
        let quality = match options.quality {
            Quality::Low => Q::RTC_BUILD_QUALITY_LOW,
            Quality::Medium => Q::RTC_BUILD_QUALITY_MEDIUM,
            Quality::High => Q::RTC_BUILD_QUALITY_HIGH,
        };
        // SAFETY: the device is live; a null scene is caught by `check` and before use.
        let raw = unsafe { sys::rtcNewScene(device.inner.raw) };
        device.check()?;
        if raw.is_null() {
            return Err(Error::Embree("the scene could not be created".into()));
        }
        let handle = Handle { raw, device: device.clone() };
        // SAFETY: `raw` is a live, uncommitted scene.
        unsafe {
            sys::rtcSetSceneFlags(raw, flags);
            sys::rtcSetSceneBuildQuality(raw, quality);
        }
        device.check()?;
        Ok(SceneBuilder { handle, triangles: 0 })
    }

    /// Adds triangles; rays see them if `mask & ray mask != 0`. The slices are copied.
    ///
    /// # Errors
    /// If an index is out of range, a position is not finite or beyond Embree's range (1.8e18), or Embree refuses.
    pub fn add_triangles(&mut self, positions: &[Vec3], triangles: &[[u32; 3]], mask: u32) -> Result<()> {
        if triangles.is_empty() {
            return Ok(());
        }
        if let Some(t) = triangles.iter().position(|t| t.iter().any(|&v| v as usize >= positions.len())) {
            return Err(Error::Embree(format!("triangle {t} refers to a vertex that does not exist")));
        }
        if let Some(v) = positions.iter().position(|p| !p.is_finite() || p.abs().max_element() > 1.8e18) {
            return Err(Error::Embree(format!("vertex {v} is not finite or too far away")));
        }
        let device = &self.handle.device;
        // SAFETY: the device is live; the geometry is used only below and released after attaching.
        let geometry = unsafe {
            sys::rtcNewGeometry(device.inner.raw, sys::RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE)
        };
        device.check()?;
        let fill = |kind, format, item_bytes: usize, bytes: &[u8]| {
            // SAFETY: Embree allocates `count * item_bytes` bytes (padded as it needs) and returns their address,
            // which stays valid until the geometry is released; exactly that many bytes are copied.
            unsafe {
                let buffer = sys::rtcSetNewGeometryBuffer(
                    geometry,
                    kind,
                    0,
                    format,
                    item_bytes,
                    bytes.len() / item_bytes,
                );
                if !buffer.is_null() {
                    std::ptr::copy_nonoverlapping(bytes.as_ptr(), buffer.cast::<u8>(), bytes.len());
                }
            }
        };
        let coordinates: Vec<[f32; 3]> = positions.iter().map(|p| p.to_array()).collect();
        fill(
            sys::RTCBufferType::RTC_BUFFER_TYPE_VERTEX,
            sys::RTCFormat::RTC_FORMAT_FLOAT3,
            12,
            bytemuck::cast_slice(&coordinates),
        );
        fill(
            sys::RTCBufferType::RTC_BUFFER_TYPE_INDEX,
            sys::RTCFormat::RTC_FORMAT_UINT3,
            12,
            bytemuck::cast_slice(triangles),
        );
        let filled = device.check();
        // SAFETY: `geometry` and the scene are live; attaching retains the geometry, so it is released here.
        unsafe {
            if filled.is_ok() {
                sys::rtcSetGeometryMask(geometry, mask);
                sys::rtcCommitGeometry(geometry);
                sys::rtcAttachGeometry(self.handle.raw, geometry);
            }
            sys::rtcReleaseGeometry(geometry);
        }
        filled?;
        self.triangles += triangles.len();
        device.check()
    }

    /// Builds the acceleration structure.
    ///
    /// # Errors
    /// If Embree refuses or runs out of memory.
    pub fn commit(self) -> Result<CommittedScene> {
        // SAFETY: the scene is live and nobody else can touch it: `self` is consumed.
        unsafe { sys::rtcCommitScene(self.handle.raw) };
        self.handle.device.check()?;
        let traversal = Traversal { width: 1, coherent: false };
        Ok(CommittedScene { handle: Arc::new(self.handle), triangles: self.triangles, traversal })
    }
}

const _: () = {
    assert!(size_of::<Packet>() == size_of::<sys::mrvis_packet>());
    assert!(std::mem::offset_of!(Packet, direction) == std::mem::offset_of!(sys::mrvis_packet, direction));
    assert!(std::mem::offset_of!(Packet, near) == std::mem::offset_of!(sys::mrvis_packet, near_t));
    assert!(std::mem::offset_of!(Packet, far) == std::mem::offset_of!(sys::mrvis_packet, far_t));
    assert!(std::mem::offset_of!(Packet, active) == std::mem::offset_of!(sys::mrvis_packet, active));
};

impl CommittedScene {
    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.triangles
    }

    /// How [`Occluder::occluded`] traces from now on.
    pub fn set_traversal(&mut self, traversal: Traversal) {
        self.traversal = traversal;
    }

    /// How [`Occluder::occluded`] traces.
    pub fn traversal(&self) -> Traversal {
        self.traversal
    }

    /// Blocked lanes of each packet, traced the way `traversal` says, against geometries that `mask` selects.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn occluded_by(&self, traversal: Traversal, mask: u32, packets: &[Packet], blocked: &mut [u32]) {
        assert_eq!(packets.len(), blocked.len());
        // SAFETY: the scene is committed and live; `Packet` has the layout of `mrvis_packet` (asserted above)
        // and its alignment; both slices hold `packets.len()` items.
        unsafe {
            sys::mrvis_occluded(
                self.handle.raw,
                packets.as_ptr().cast(),
                packets.len(),
                traversal.width as i32,
                i32::from(traversal.coherent),
                mask,
                blocked.as_mut_ptr(),
            );
        }
    }
}

/// What the segments of a packet meet first. Field order and layout are those of `mrvis_hits` in
/// `ffi/embree/shim.h`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Hits {
    /// The triangle's number within its geometry; [`Hits::NOTHING`] where nothing is met.
    pub triangle: [u32; LANES],
    /// The parameter of the hit; without meaning where nothing is met.
    pub t: [f32; LANES],
}

impl Hits {
    /// The number that stands for no triangle.
    pub const NOTHING: u32 = u32::MAX;
    /// No lane meets anything.
    pub const NONE: Hits = Hits { triangle: [Self::NOTHING; LANES], t: [0.0; LANES] };
}

const _: () = assert!(size_of::<Hits>() == size_of::<sys::mrvis_hits>());

impl CommittedScene {
    /// What each segment meets first, traced the way `traversal` says.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn first_hits(&self, traversal: Traversal, packets: &[Packet], hits: &mut [Hits]) {
        assert_eq!(packets.len(), hits.len());
        // SAFETY: the scene is committed and live; `Packet` and `Hits` have the layouts of the C structs (asserted
        // above) and their alignment; both slices hold `packets.len()` items.
        unsafe {
            sys::mrvis_first_hits(
                self.handle.raw,
                packets.as_ptr().cast(),
                packets.len(),
                traversal.width as i32,
                i32::from(traversal.coherent),
                u32::MAX,
                hits.as_mut_ptr().cast(),
            );
        }
    }
}

impl Occluder for CommittedScene {
    fn occluded(&self, packets: &[Packet], blocked: &mut [u32]) {
        self.occluded_by(self.traversal, u32::MAX, packets, blocked);
    }
}
