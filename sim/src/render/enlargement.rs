//! Pictures of more pixels than policies see, for people: each put together from pictures of the usual size, whose cameras look
//! through parts of the usual one's window.

use std::ops::RangeInclusive;

use super::CpuRenderer;
use super::camera::Camera;
use super::scene::RenderScene;
use crate::scene::{Scene, Snapshot};

/// A scene whose cameras have so many times as many pixels along each edge.
pub struct Enlargement {
    /// Per camera as many others as there are parts of its picture, row by row.
    parts: RenderScene,
    times: usize,
}

impl Enlargement {
    /// How many times.
    pub const TIMES: RangeInclusive<usize> = 1..=8;

    /// Prepares a scene.
    ///
    /// # Panics
    /// If it is not so many times as [`Self::TIMES`] says.
    #[must_use]
    pub fn new(scene: &Scene, times: usize) -> Self {
        assert!(Self::TIMES.contains(&times), "{times} times");
        let windows = || (0..times * times).map(move |part| [part % times, part / times]);
        let cameras = scene.cameras.iter().map(Camera::new);
        let parts = cameras.flat_map(|camera| windows().map(move |window| camera.part(times, window)));
        Self { parts: RenderScene::with_cameras(scene, parts.collect()), times }
    }

    /// Every camera's side and its image, `[side, side, 3] u8` sRGB; one time as many pixels are
    /// [`CpuRenderer::photograph`]'s, byte for byte.
    ///
    /// # Panics
    /// If the snapshot is not of the scene.
    #[must_use]
    pub fn photograph(&self, renderer: &mut CpuRenderer, snapshot: &Snapshot) -> Vec<(usize, Vec<u8>)> {
        let parts = renderer.photograph(&self.parts, snapshot);
        parts.chunks_exact(self.times * self.times).map(|parts| self.join(parts)).collect()
    }

    fn join(&self, parts: &[(usize, Vec<u8>)]) -> (usize, Vec<u8>) {
        let row_len = parts[0].0 * 3;
        let mut image = Vec::with_capacity(parts.iter().map(|(_, part)| part.len()).sum());
        for row_of_parts in parts.chunks_exact(self.times) {
            for row in 0..parts[0].0 {
                let rows = row_of_parts.iter().map(|(_, part)| &part[row * row_len..][..row_len]);
                rows.for_each(|row| image.extend_from_slice(row));
            }
        }
        (self.times * parts[0].0, image)
    }
}
