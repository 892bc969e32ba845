//! What cameras see, `--importance-camera`.

use glam::DVec3;
use mrvis::internals::SceneParts;
use mrvis::internals::radiosity::View;
use mrvis::internals::scene::StoredCamera;
use mrvis::{Error, Result, Scene};

/// The cameras of `--importance-camera`.
pub fn views(scene: &Scene, given: Option<[f64; 7]>) -> Result<Vec<View>> {
    let views: Vec<View> = match given {
        Some([x, y, z, u, v, w, degrees]) => {
            let eye = DVec3::new(x, y, z);
            let forward = (DVec3::new(u, v, w) - eye).normalize();
            vec![View { eye, forward, angle: degrees.to_radians() }]
        }
        None => {
            let of = |c: &StoredCamera| View { eye: c.eye, forward: c.forward, angle: c.angle };
            scene.parts().cameras.iter().map(of).collect()
        }
    };
    if views.is_empty() {
        return Err(Error::arguments(
            "--importance-camera: the scene has no camera; give one with --camera".into(),
        ));
    }
    Ok(views)
}
