//! Norms that do not depend on feature sizes [SD95 sec 2.1].

use super::Image;
use crate::Result;

/// Errors of an approximation as means over the texels, in the units of the image values.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Norms {
    /// Mean absolute difference.
    pub l1: f64,
    /// Root mean square difference.
    pub l2: f64,
    /// Mean of approximation − reference: positive if the approximation is too bright.
    pub bias: f64,
    /// Largest absolute difference.
    pub max: f64,
}

/// The norms of `approximation` − `reference`.
///
/// # Errors
/// [`Error::Argument`](crate::Error::Argument) if the images differ in columns or rows.
pub fn norms(reference: &Image, approximation: &Image) -> Result<Norms> {
    let d = difference(reference, approximation)?;
    let mean = |f: fn(f64) -> f64| d.iter().map(|&d| f(d)).sum::<f64>() / d.len() as f64;
    Ok(Norms {
        l1: mean(f64::abs),
        l2: mean(|d| d * d).sqrt(),
        bias: mean(|d| d),
        max: d.iter().fold(0.0, |m, d| d.abs().max(m)),
    })
}

/// `approximation` − `reference`, texel by texel. Errors as for [`norms`].
pub fn difference(reference: &Image, approximation: &Image) -> Result<Vec<f64>> {
    reference.check_same_sides(approximation)?;
    let pairs = approximation.data().iter().zip(reference.data());
    Ok(pairs.map(|(&a, &r)| f64::from(a) - f64::from(r)).collect())
}

/// |d|^p.
#[inline]
pub(super) fn power(d: f64, p: f64) -> f64 {
    if p == 2.0 { d * d } else { d.abs().powf(p) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        let reference = Image::new(2, 2, 1.0, vec![1.0, 0.0, 0.5, 1.0]).unwrap();
        let approximation = Image::new(2, 2, 1.0, vec![0.5, 0.5, 0.5, 2.0]).unwrap();
        let n = norms(&reference, &approximation).unwrap();
        assert_eq!((n.l1, n.l2, n.bias, n.max), (0.5, (1.5f64 / 4.0).sqrt(), 0.25, 1.0));
        assert!(norms(&reference, &Image::new(4, 1, 1.0, vec![0.0; 4]).unwrap()).is_err());
    }
}
