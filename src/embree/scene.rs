//! Scene construction, commit, and ray queries.

use super::device::Device;
use super::sys::{self, GridPiece, Hits};
use crate::error::{Error, Result};
use crate::ray::{LANES, Occluder, Packet};
use glam::{Affine3A, Vec3};
use std::ffi::c_void;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

/// Traversal of packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Traversal {
    /// Rays per Embree call: 1, 4, 8 or 16. Other values count as 1.
    pub width: usize,
    /// Whether to use Embree's traversal for coherent rays; no effect at width 1.
    pub coherent: bool,
}

impl Traversal {
    /// One ray at a time.
    const SINGLE: Traversal = Traversal { width: 1, coherent: false };
}

/// The triangle that a hit of a grid counts as, by the number of the piece and the place on it, columns and rows from 0 to 1.
pub type PieceTriangle = Arc<dyn Fn(u32, [f32; 2]) -> u32 + Send + Sync>;

/// Packets that are traced at once in scenes with grids.
const BLOCK: usize = 16;

/// A scene under construction.
pub struct SceneBuilder {
    handle: Handle,
    /// Triangles of the pieces of its grid, if there is one.
    grid: Option<PieceTriangle>,
}

/// An immutable scene; any number of threads may trace it. Cheap to clone: clones share the geometry.
#[derive(Clone)]
pub struct CommittedScene {
    handle: Arc<Handle>,
    grid: Option<PieceTriangle>,
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
    /// Starts an empty scene.
    ///
    /// # Errors
    /// [`Error::Embree`] if Embree reports an error.
    pub fn new(device: &Device) -> Result<SceneBuilder> {
        // SAFETY: the device is live; a null scene is caught by `check` and before use.
        let raw = unsafe { sys::rtcNewScene(device.raw()) };
        device.check()?;
        if raw.is_null() {
            return Err(Error::Embree("the scene could not be created".into()));
        }
        let handle = Handle { raw, device: device.clone() };
        // Conservative box and edge tests: no cracks between adjacent triangles, at a somewhat lower speed. Embree ignores flags after a
        // commit.
        // SAFETY: `raw` is a live, uncommitted scene.
        unsafe { sys::rtcSetSceneFlags(raw, sys::RTCSceneFlags::RTC_SCENE_FLAG_ROBUST) };
        device.check()?;
        Ok(SceneBuilder { handle, grid: None })
    }

    /// Adds a geometry of triangles. The slices are copied.
    ///
    /// # Errors
    /// [`Error::Embree`] if an index is out of range, a position is not finite or exceeds Embree's range (1.8e18), or
    /// Embree reports an error.
    pub fn add_triangles(&mut self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<()> {
        if triangles.is_empty() {
            return Ok(());
        }
        if let Some(t) = triangles.iter().position(|t| t.iter().any(|&v| v as usize >= positions.len())) {
            return Err(Error::Embree(format!("triangle {t} refers to a vertex that does not exist")));
        }
        if let Some(v) = positions.iter().position(|p| !p.is_finite() || p.abs().max_element() > 1.8e18) {
            return Err(Error::Embree(format!("vertex {v} is not finite or too far away")));
        }
        let coordinates: Vec<[f32; 3]> = positions.iter().map(|p| p.to_array()).collect();
        self.add_geometry(
            sys::RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE,
            &coordinates,
            sys::RTCBufferType::RTC_BUFFER_TYPE_INDEX,
            sys::RTCFormat::RTC_FORMAT_UINT3,
            bytemuck::cast_slice(triangles),
            0,
        )
    }

    /// Adds rectangles of the samples of a grid, with two triangles for each four neighbours: from the first sample of a row, the second
    /// corner and the third of the quadrangle are joined. [`Hits::triangle`] is the value of `triangle`. A scene has one grid at most.
    ///
    /// # Errors
    /// [`Error::Embree`] if a piece has samples that do not exist, or Embree reports an error. Pieces with samples that are not finite are
    /// not hit.
    pub fn add_grid(
        &mut self,
        positions: &[[f32; 3]],
        pieces: &[GridPiece],
        triangle: PieceTriangle,
    ) -> Result<()> {
        let last = |piece: &GridPiece| {
            let [columns, rows] = piece.size.map(u64::from);
            u64::from(piece.first) + (rows - 1) * u64::from(piece.stride) + columns - 1
        };
        let is_wrong =
            |piece: &GridPiece| piece.size.iter().any(|n| *n < 2) || last(piece) >= positions.len() as u64;
        if self.grid.is_some() || pieces.len() >= Hits::PIECE as usize || pieces.iter().any(is_wrong) {
            return Err(Error::Embree("a grid has pieces outside, or the scene has a grid already".into()));
        }
        self.add_geometry(
            sys::RTCGeometryType::RTC_GEOMETRY_TYPE_GRID,
            positions,
            sys::RTCBufferType::RTC_BUFFER_TYPE_GRID,
            sys::RTCFormat::RTC_FORMAT_GRID,
            bytemuck::cast_slice(pieces),
            1,
        )?;
        self.grid = Some(triangle);
        Ok(())
    }

    /// Adds a geometry of vertices and a buffer of items of twelve bytes, of this kind and format, that refer to them.
    fn add_geometry(
        &mut self,
        kind: sys::RTCGeometryType,
        positions: &[[f32; 3]],
        buffer: sys::RTCBufferType,
        format: sys::RTCFormat,
        items: &[u8],
        id: u32,
    ) -> Result<()> {
        /// Bytes of a vertex, of a triangle and of a piece of a grid.
        const ITEM_BYTES: usize = 12;
        let device = &self.handle.device;
        // SAFETY: the device is live; the geometry is used only below and released after attaching.
        let geometry = unsafe { sys::rtcNewGeometry(device.raw(), kind) };
        device.check()?;
        let fill = |buffer, format, bytes: &[u8]| {
            // SAFETY: Embree allocates `count * ITEM_BYTES` bytes (padded as it needs) and returns their address,
            // which stays valid until the geometry is released; exactly that many bytes are copied.
            unsafe {
                let count = bytes.len() / ITEM_BYTES;
                let buffer = sys::rtcSetNewGeometryBuffer(geometry, buffer, 0, format, ITEM_BYTES, count);
                if !buffer.is_null() {
                    std::ptr::copy_nonoverlapping(bytes.as_ptr(), buffer.cast::<u8>(), bytes.len());
                }
            }
        };
        let vertices = bytemuck::cast_slice(positions);
        fill(sys::RTCBufferType::RTC_BUFFER_TYPE_VERTEX, sys::RTCFormat::RTC_FORMAT_FLOAT3, vertices);
        fill(buffer, format, items);
        let filled = device.check();
        // SAFETY: `geometry` and the scene are live; attaching retains the geometry, so it is released here.
        unsafe {
            if filled.is_ok() {
                sys::rtcCommitGeometry(geometry);
                sys::rtcAttachGeometryByID(self.handle.raw, geometry, id);
            }
            sys::rtcReleaseGeometry(geometry);
        }
        filled?;
        device.check()
    }

    /// Adds an instance of a committed scene of triangles, placed by `transform` (from the frame of that scene to the
    /// frame of this scene, invertible). [`Hits::instance`] names it `index`; every index is used once.
    ///
    /// # Errors
    /// [`Error::Embree`] if Embree reports an error.
    pub fn add_instance(&mut self, scene: &CommittedScene, transform: Affine3A, index: u32) -> Result<()> {
        let device = &self.handle.device;
        if device.raw() != scene.handle.device.raw() {
            return Err(Error::Embree("the instanced scene belongs to another device".into()));
        }
        if self.grid.is_some() && scene.grid.is_some() {
            return Err(Error::Embree("two instances have a grid".into()));
        }
        self.grid = self.grid.take().or_else(|| scene.grid.clone());
        // SAFETY: the device is live; the geometry is used only below and released after attaching.
        let geometry =
            unsafe { sys::rtcNewGeometry(device.raw(), sys::RTCGeometryType::RTC_GEOMETRY_TYPE_INSTANCE) };
        device.check()?;
        let columns = transform.to_cols_array();
        // SAFETY: the geometry and both scenes are live; Embree copies the twelve floats and retains the instanced
        // scene and the attached geometry, so that both handles may be released afterwards.
        unsafe {
            sys::rtcSetGeometryInstancedScene(geometry, scene.handle.raw);
            sys::rtcSetGeometryTransform(
                geometry,
                0,
                sys::RTCFormat::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR,
                columns.as_ptr().cast(),
            );
            sys::rtcCommitGeometry(geometry);
            sys::rtcAttachGeometryByID(self.handle.raw, geometry, index);
            sys::rtcReleaseGeometry(geometry);
        }
        device.check()
    }

    /// Builds the acceleration structure.
    ///
    /// # Errors
    /// [`Error::Embree`] if Embree reports an error, such as lack of memory.
    pub fn commit(self) -> Result<CommittedScene> {
        self.commit_unless(&|| false)
    }

    /// Like [`SceneBuilder::commit`]; ends soon after `stopped` returns true, from any thread.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if it was stopped; those of [`SceneBuilder::commit`].
    pub fn commit_unless(self, stopped: Stopped) -> Result<CommittedScene> {
        let user = (&raw const stopped).cast_mut().cast::<c_void>();
        // SAFETY: the scene is live and no other reference to it exists: `self` is consumed. `user` points to `stopped`, which outlives
        // the commit; Embree calls the function during the commit only, and it is removed afterwards.
        unsafe {
            sys::rtcSetSceneProgressMonitorFunction(self.handle.raw, Some(on_progress), user);
            sys::rtcCommitScene(self.handle.raw);
            sys::rtcSetSceneProgressMonitorFunction(self.handle.raw, None, std::ptr::null_mut());
        }
        self.handle.device.check()?;
        Ok(CommittedScene { handle: Arc::new(self.handle), grid: self.grid })
    }
}

/// Tells whether a commit shall stop.
type Stopped<'a> = &'a (dyn Fn() -> bool + Sync);

/// Returns whether the commit goes on.
extern "C" fn on_progress(user: *mut c_void, _part: f64) -> bool {
    // SAFETY: `user` is the address of a `Stopped` that outlives the commit, see `commit_unless`.
    let stopped = unsafe { &*user.cast::<Stopped>() };
    // A panic must not cross Embree; it ends the commit.
    catch_unwind(AssertUnwindSafe(|| !stopped())).unwrap_or(false)
}

impl CommittedScene {
    /// Sets `blocked[k]` to the mask of blocked lanes of `packets[k]`.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn occluded_by(&self, traversal: Traversal, packets: &[Packet], blocked: &mut [u32]) {
        assert_eq!(packets.len(), blocked.len());
        // SAFETY: the scene is committed and live; `Packet` has the layout and alignment of `mrvis_packet`
        // (asserted in `sys`); both slices hold `packets.len()` items.
        unsafe {
            sys::mrvis_occluded(
                self.handle.raw,
                packets.as_ptr(),
                packets.len(),
                traversal.width as i32,
                i32::from(traversal.coherent),
                blocked.as_mut_ptr(),
            );
        }
    }

    /// Finds the first triangle that each segment hits.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn first_hits(&self, traversal: Traversal, packets: &[Packet], hits: &mut [Hits]) {
        assert_eq!(packets.len(), hits.len());
        let trace = |packets: &[Packet], hits: &mut [Hits], places: *mut [[f32; LANES]; 2]| {
            // SAFETY: the scene is committed and live; `Packet` and `Hits` have the layouts and alignments of the C
            // structs (asserted in `sys`); both slices hold `packets.len()` items, `places` as many or it is null.
            unsafe {
                sys::mrvis_first_hits(
                    self.handle.raw,
                    packets.as_ptr(),
                    packets.len(),
                    traversal.width as i32,
                    i32::from(traversal.coherent),
                    hits.as_mut_ptr(),
                    places,
                );
            }
        };
        let Some(grid) = &self.grid else { return trace(packets, hits, std::ptr::null_mut()) };
        for (packets, hits) in packets.chunks(BLOCK).zip(hits.chunks_mut(BLOCK)) {
            let mut places = [[[0.0; LANES]; 2]; BLOCK];
            trace(packets, hits, places.as_mut_ptr());
            for (hits, [u, v]) in hits.iter_mut().zip(&places) {
                for (triangle, (&u, &v)) in hits.triangle.iter_mut().zip(u.iter().zip(v)) {
                    if *triangle != Hits::NO_HIT && *triangle & Hits::PIECE != 0 {
                        *triangle = grid(*triangle & !Hits::PIECE, [u, v]);
                    }
                }
            }
        }
    }
}

impl Occluder for CommittedScene {
    fn occluded(&self, packets: &[Packet], blocked: &mut [u32]) {
        self.occluded_by(Traversal::SINGLE, packets, blocked);
    }
}
