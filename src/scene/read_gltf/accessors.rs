//! Numbers of accessors; every access is checked.

use super::Reader;
use crate::Result;
use gltf::{
    Accessor,
    accessor::{DataType, Dimensions},
};

impl Reader<'_> {
    /// The numbers of an accessor, `N` per item.
    pub fn values<const N: usize>(&self, accessor: &Accessor) -> Result<Vec<[f64; N]>> {
        let wrong = |what: &str| self.wrong(format!("accessor {}: {what}", accessor.index()));
        let wide = match accessor.dimensions() {
            Dimensions::Scalar => 1,
            Dimensions::Vec2 => 2,
            Dimensions::Vec3 => 3,
            Dimensions::Vec4 => 4,
            _ => 0,
        };
        if wide != N {
            return Err(wrong("of the wrong kind for its use"));
        }
        if accessor.sparse().is_some() {
            return Err(wrong("sparse accessors are not read; export the scene without them"));
        }
        let view =
            accessor.view().ok_or_else(|| wrong("has no data; export the scene without compression"))?;
        let buffer = self.buffers.get(view.buffer().index()).ok_or_else(|| wrong("has no buffer"))?;
        let size = accessor.data_type().size();
        let stride = view.stride().unwrap_or(N * size);
        let end = view.offset().checked_add(view.length()).filter(|&end| end <= buffer.len());
        let data =
            end.map(|end| &buffer[view.offset()..end]).ok_or_else(|| wrong("lies outside its buffer"))?;
        let last = accessor.count().checked_sub(1).and_then(|n| n.checked_mul(stride));
        let needed = last.and_then(|l| l.checked_add(N * size)?.checked_add(accessor.offset()));
        if stride < N * size || needed.is_none_or(|n| n > data.len()) {
            return Err(wrong("lies outside its buffer view"));
        }
        let scale = if accessor.normalized() { normal_scale(accessor.data_type()) } else { 1.0 };
        let item = |i: usize| {
            let start = accessor.offset() + i * stride;
            std::array::from_fn(|c| number(&data[start + c * size..], accessor.data_type()) * scale)
        };
        Ok((0..accessor.count()).map(item).collect())
    }
}

/// Factor that turns a normalized integer into `[0, 1]` or `[-1, 1]`.
fn normal_scale(kind: DataType) -> f64 {
    match kind {
        DataType::I8 => 1.0 / 127.0,
        DataType::U8 => 1.0 / 255.0,
        DataType::I16 => 1.0 / 32767.0,
        DataType::U16 => 1.0 / 65535.0,
        DataType::U32 | DataType::F32 => 1.0,
    }
}

/// The number at the start of `bytes` (little-endian), which must be long enough.
fn number(bytes: &[u8], kind: DataType) -> f64 {
    match kind {
        DataType::I8 => f64::from(bytes[0] as i8),
        DataType::U8 => f64::from(bytes[0]),
        DataType::I16 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
        DataType::U16 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        DataType::U32 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        DataType::F32 => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
    }
}
