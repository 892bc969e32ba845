//! The upper convex hull of points that arrive in order of their positions on a line.

/// Upper convex hull. Positions in columns, counted away from where the sweep began, so that they increase.
#[derive(Default)]
pub struct Hull {
    points: Vec<[f32; 2]>,
}

impl Hull {
    /// Removes all points.
    pub fn clear(&mut self) {
        self.points.clear();
    }

    /// Adds a point behind all others. Heights that are not numbers are left out.
    #[inline]
    pub fn push(&mut self, x: f32, height: f32) {
        if height.is_nan() {
            return;
        }
        while let [.., a, b] = self.points[..] {
            // Whether b is above the chord from a to the new point.
            if (b[1] - a[1]) * (x - a[0]) > (height - a[1]) * (b[0] - a[0]) {
                break;
            }
            self.points.pop();
        }
        self.points.push([x, height]);
    }

    /// Largest slope, height per column, from a place behind all points to a point; −∞ without points.
    ///
    /// Slopes along the hull have one maximum. The search starts at the last point: most horizons are near.
    #[inline]
    pub fn slope(&self, x: f32, height: f32) -> f32 {
        let Some((&last, rest)) = self.points.split_last() else { return f32::NEG_INFINITY };
        let (mut rise, mut distance) = (last[1] - height, x - last[0]);
        for point in rest.iter().rev() {
            let (r, d) = (point[1] - height, x - point[0]);
            if r * distance < rise * d {
                break;
            }
            (rise, distance) = (r, d);
        }
        rise / distance
    }
}
