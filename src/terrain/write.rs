//! Values of samples in files: GeoTIFF with the georeference of the grid, NumPy archives, pictures.

use super::Grid;
use crate::files::{NpzWriter, WholeFile};
use crate::{Error, Result, memory};
use std::io::{Cursor, Write};
use std::path::Path;
use tiff::TiffResult;
use tiff::encoder::{TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard};
use tiff::tags::Tag;

/// A quantity at all samples of a grid.
#[derive(Clone, Copy, Debug)]
pub struct Layer<'a> {
    /// Its name: that of the array, the description of the band.
    pub name: &'a str,
    /// `columns * rows` values, row by row from the north; NaN in holes.
    pub values: &'a [f32],
}

/// Bytes of a strip: 36 strips for a band of 3,000 × 3,000, and a part of the file can be read without the rest.
const STRIP: usize = 1 << 20;
/// Room for what precedes and follows the bands in a file, bytes.
const HEADER: usize = 1 << 16;
/// Bytes of a TIFF file whose offsets have 32 bits, less room for tags; larger ones are BigTIFF.
const MAX_SMALL_TIFF: u64 = (1 << 32) - (16 << 20);

fn check(grid: &Grid, layers: &[Layer]) -> Result<()> {
    let samples = grid.heights().len();
    match layers.iter().find(|l| l.values.len() != samples) {
        Some(Layer { name, values }) => {
            Err(Error::arguments(format!("`{name}` has {} values, the grid {samples} samples", values.len())))
        }
        // The number of bands has 16 bits.
        None if layers.is_empty() || layers.len() > usize::from(u16::MAX) => {
            Err(Error::arguments(format!("{} layers: a file has 1 to {}", layers.len(), u16::MAX)))
        }
        None => Ok(()),
    }
}

/// Writes layers as bands of a GeoTIFF of 32-bit floats with the georeference of the grid, completely or not at all. Bands are
/// described by the names of the layers; samples without a value are NaN.
///
/// # Errors
/// [`Error::Argument`] if a layer does not fit the grid, [`Error::Io`], [`Error::OutOfMemory`].
pub fn write_geotiff(path: &Path, grid: &Grid, layers: &[Layer]) -> Result<()> {
    check(grid, layers)?;
    let bytes = 4 * (layers.len() * grid.heights().len()) as u64;
    memory::check_room(bytes + HEADER as u64, || format!("{} bands of a GeoTIFF", layers.len()))?;
    let mut out = Cursor::new(Vec::with_capacity(bytes as usize + HEADER));
    let written = match bytes > MAX_SMALL_TIFF {
        true => {
            TiffEncoder::<_, TiffKindBig>::new_generic(&mut out).and_then(|e| encode(e, grid, layers, |v| v))
        }
        false => TiffEncoder::<_, TiffKindStandard>::new_generic(&mut out)
            .and_then(|e| encode(e, grid, layers, |v| v as u32)),
    };
    written.map_err(|e| Error::format(path, None, format!("cannot be encoded: {e}")))?;
    WholeFile::write(path, out.into_inner())
}

/// Writes the only image of a file. `offset` makes an offset of this kind of TIFF.
fn encode<W: Write + std::io::Seek, K: TiffKind, O>(
    mut file: TiffEncoder<W, K>,
    grid: &Grid,
    layers: &[Layer],
    offset: impl Fn(u64) -> O,
) -> TiffResult<()>
where
    [O]: tiff::encoder::TiffValue,
{
    let (columns, rows, bands) = (grid.columns(), grid.rows(), layers.len());
    let strip_rows = (STRIP / (4 * columns)).clamp(1, rows);
    let mut image = file.image_directory()?;
    let (mut offsets, mut lengths) = (Vec::new(), Vec::new());
    for layer in layers {
        for strip in layer.values.chunks(strip_rows * columns) {
            offsets.push(offset(image.write_data(strip)?));
            lengths.push(4 * strip.len() as u32);
        }
    }
    image.write_tag(Tag::ImageWidth, columns as u32)?;
    image.write_tag(Tag::ImageLength, rows as u32)?;
    image.write_tag(Tag::BitsPerSample, &vec![32u16; bands][..])?;
    // Not compressed; black is 0; one band after the other; floating-point numbers.
    image.write_tag(Tag::Compression, 1u16)?;
    image.write_tag(Tag::PhotometricInterpretation, 1u16)?;
    image.write_tag(Tag::StripOffsets, &offsets[..])?;
    image.write_tag(Tag::SamplesPerPixel, bands as u16)?;
    image.write_tag(Tag::RowsPerStrip, strip_rows as u32)?;
    image.write_tag(Tag::StripByteCounts, &lengths[..])?;
    image.write_tag(Tag::PlanarConfiguration, if bands > 1 { 2u16 } else { 1 })?;
    if bands > 1 {
        image.write_tag(Tag::ExtraSamples, &vec![0u16; bands - 1][..])?;
    }
    image.write_tag(Tag::SampleFormat, &vec![3u16; bands][..])?;
    let georeference = grid.georeference();
    image.write_tag(Tag::ModelPixelScaleTag, &georeference.scale[..])?;
    image.write_tag(Tag::ModelTiepointTag, &georeference.tie_point[..])?;
    if !georeference.keys.is_empty() {
        image.write_tag(Tag::GeoKeyDirectoryTag, &georeference.keys[..])?;
    }
    if !georeference.doubles.is_empty() {
        image.write_tag(Tag::GeoDoubleParamsTag, &georeference.doubles[..])?;
    }
    if !georeference.text.is_empty() && georeference.text.is_ascii() {
        image.write_tag(Tag::GeoAsciiParamsTag, georeference.text.as_str())?;
    }
    image.write_tag(Tag::Unknown(GDAL_METADATA), &descriptions(layers)[..])?;
    image.write_tag(Tag::GdalNodata, "nan")?;
    image.finish()
}

/// The tag in which GDAL keeps descriptions of bands.
const GDAL_METADATA: u16 = 42112;

/// Names of layers as GDAL reads them.
fn descriptions(layers: &[Layer]) -> String {
    let item = |(i, layer): (usize, &Layer)| {
        let name: String = layer.name.chars().filter(|c| c.is_ascii() && !"<>&".contains(*c)).collect();
        format!("<Item name=\"DESCRIPTION\" sample=\"{i}\" role=\"description\">{name}</Item>")
    };
    let items: String = layers.iter().enumerate().map(item).collect();
    format!("<GDALMetadata>{items}</GDALMetadata>")
}

/// Writes layers as arrays `(rows, columns)` of float32 into a NumPy archive, completely or not at all, with the coordinates of
/// columns, `x`, and rows, `y`, float64.
///
/// # Errors
/// [`Error::Argument`] if a layer does not fit the grid, [`Error::Io`].
pub fn write_npz(path: &Path, grid: &Grid, layers: &[Layer]) -> Result<()> {
    check(grid, layers)?;
    let mut file = WholeFile::create(path)?;
    npz(&mut file, grid, layers).map_err(|e| Error::io(path, e))?;
    file.commit()
}

fn npz(out: &mut impl Write, grid: &Grid, layers: &[Layer]) -> std::io::Result<()> {
    let mut archive = NpzWriter::new(out);
    let georeference = grid.georeference();
    let x: Vec<f64> = (0..grid.columns()).map(|c| georeference.position(c, 0)[0]).collect();
    let y: Vec<f64> = (0..grid.rows()).map(|r| georeference.position(0, r)[1]).collect();
    archive.array("x", "<f8", &[x.len()], bytemuck::cast_slice(&x))?;
    archive.array("y", "<f8", &[y.len()], bytemuck::cast_slice(&y))?;
    for layer in layers {
        archive.array(
            layer.name,
            "<f4",
            &[grid.rows(), grid.columns()],
            bytemuck::cast_slice(layer.values),
        )?;
    }
    archive.finish()
}

/// Writes a layer as a picture: `range[0]` dark, `range[1]` bright, on the colour map of all false colours; samples without a
/// value white.
///
/// # Errors
/// [`Error::Argument`] if the layer does not fit the grid or the range is empty, [`Error::Io`].
pub fn write_png(path: &Path, grid: &Grid, layer: Layer, range: [f32; 2]) -> Result<()> {
    use crate::image_io::{Picture, false_colour, write_png};
    check(grid, &[layer])?;
    let [low, high] = range;
    if low >= high || !(high - low).is_finite() {
        return Err(Error::arguments(format!("the range {low}..{high} of the picture is empty")));
    }
    let colour = |v: &f32| if v.is_nan() { [255; 3] } else { false_colour((v - low) / (high - low)) };
    let pixels = layer.values.iter().map(colour).collect();
    write_png(path, &Picture { width: grid.columns(), height: grid.rows(), pixels })
}
