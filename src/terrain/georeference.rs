//! Where a grid is on the earth, in the terms of GeoTIFF (OGC 19-008r4).

/// Key: kind of coordinate system.
pub const MODEL_TYPE: u16 = 1024;
/// Key: unit of projected lengths.
pub const LENGTHS: u16 = 3076;
/// Value of [`MODEL_TYPE`]: longitude and latitude.
pub const GEOGRAPHIC: u16 = 2;
/// Key: whether tie points are of corners of pixels (1) or of samples (2).
const RASTER_TYPE: u16 = 1025;

/// Position, scale and coordinate system of a grid. Outputs get them unchanged.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Georeference {
    /// Column, row, 0, and the x, y and z that they lie at in the coordinate system.
    pub tie_point: [f64; 6],
    /// Lengths of a column and a row in units of the coordinate system, both positive: x grows with columns, y falls with rows;
    /// the third is 0.
    pub scale: [f64; 3],
    /// The tag GeoKeyDirectory, empty without a coordinate system.
    pub keys: Vec<u16>,
    /// The tag GeoDoubleParams.
    pub doubles: Vec<f64>,
    /// The tag GeoAsciiParams.
    pub text: String,
}

impl Georeference {
    /// The frame of a grid without a coordinate system: the sample of the first column and the last row is the origin.
    pub fn local(rows: usize, cell: [f64; 2]) -> Georeference {
        Georeference::of_samples([0.0, (rows - 1) as f64 * cell[1]], cell)
    }

    /// From the position of the first sample and the lengths of a column and a row.
    pub fn of_samples([x, y]: [f64; 2], [dx, dy]: [f64; 2]) -> Georeference {
        Georeference {
            tie_point: [0.0, 0.0, 0.0, x, y, 0.0],
            scale: [dx, dy, 0.0],
            // Version 1.1 of the directory with two keys: samples are points, lengths metres.
            keys: vec![1, 1, 0, 2, RASTER_TYPE, 0, 1, 2, LENGTHS, 0, 1, 9001],
            ..Georeference::default()
        }
    }

    /// The value of a key that is a number in the directory.
    pub fn key(&self, key: u16) -> Option<u16> {
        let entries = self.keys.get(4..)?.chunks_exact(4);
        entries.filter(|e| e[0] == key && e[1] == 0).map(|e| e[3]).next()
    }

    /// Position of the sample of a column and a row in the coordinate system.
    pub fn position(&self, column: usize, row: usize) -> [f64; 2] {
        // A pixel is an area unless the file says otherwise; the sample is its middle.
        let half = if self.key(RASTER_TYPE) == Some(2) { 0.0 } else { 0.5 };
        let [i, j, _, x, y, _] = self.tie_point;
        [x + (column as f64 + half - i) * self.scale[0], y - (row as f64 + half - j) * self.scale[1]]
    }
}
