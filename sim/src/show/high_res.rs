//! Renderings at several times the resolution of the observations, for videos. Each image is assembled from
//! tiles of the usual size, because the rasteriser's integer coordinates cover 224 × 224 px and a guard band.
//! The camera of a tile looks off its axis, through its part of the image plane.

use std::ops::RangeInclusive;

use render::{CpuRenderer, RenderScene};
use scene::{Scene, Snapshot};

/// A scene whose cameras have `scale` times as many pixels along each edge as the observation cameras.
pub struct HighResScene {
    /// Scene with `scale` × `scale` tile cameras per camera, in row-major order.
    tiles: RenderScene,
    scale: usize,
}

impl HighResScene {
    /// Supported scale factors.
    pub const SCALES: RangeInclusive<usize> = 1..=8;

    /// Prepares a scene for rendering at `scale` times the usual resolution.
    ///
    /// # Panics
    /// If `scale` is not in [`Self::SCALES`].
    #[must_use]
    pub fn new(scene: &Scene, scale: usize) -> Self {
        assert!(Self::SCALES.contains(&scale), "scale {scale} is not in {:?}", Self::SCALES);
        Self { tiles: RenderScene::with_tiled_cameras(scene, scale), scale }
    }

    /// Renders all cameras. Returns each camera's side in px and its `[side, side, 3] u8` sRGB image. At
    /// scale 1 the result is identical to [`CpuRenderer::render_cameras`].
    ///
    /// # Panics
    /// If the snapshot does not belong to the scene.
    #[must_use]
    pub fn render_cameras(&self, renderer: &mut CpuRenderer, snapshot: &Snapshot) -> Vec<(usize, Vec<u8>)> {
        let tiles = renderer.render_cameras(&self.tiles, snapshot);
        tiles.chunks_exact(self.scale * self.scale).map(|tiles| self.assemble(tiles)).collect()
    }

    /// Renders one camera only. Returns its side in px and its `[side, side, 3] u8` sRGB image.
    ///
    /// # Panics
    /// If the snapshot does not belong to the scene, or the scene has no such camera.
    #[must_use]
    pub fn render_camera(
        &self,
        renderer: &mut CpuRenderer,
        snapshot: &Snapshot,
        camera_idx: usize,
    ) -> (usize, Vec<u8>) {
        let n_tiles = self.scale * self.scale;
        let first = camera_idx * n_tiles;
        self.assemble(&renderer.render_camera_range(&self.tiles, snapshot, first..first + n_tiles))
    }

    /// Assembles the tiles of one camera into one image.
    fn assemble(&self, tiles: &[(usize, Vec<u8>)]) -> (usize, Vec<u8>) {
        let tile_side = tiles[0].0;
        let row_len = tile_side * 3;
        let mut image = Vec::with_capacity(tiles.iter().map(|(_, tile)| tile.len()).sum());
        for row_of_tiles in tiles.chunks_exact(self.scale) {
            for row in 0..tile_side {
                for (_, tile) in row_of_tiles {
                    image.extend_from_slice(&tile[row * row_len..][..row_len]);
                }
            }
        }
        (self.scale * tile_side, image)
    }
}
