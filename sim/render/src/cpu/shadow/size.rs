//! Sizes and resolutions of shadow maps.

use crate::cpu::visibility::tile::{DepthTile, TileLayout};
use crate::shading::{SHADOW_DEPTH_LEVELS, SHADOW_HALF_DEPTH_M, SHADOW_MAP_SIDE, SHADOW_MAP_WIDTH_M};

/// Number of texels along each edge of a shadow map.
pub(crate) const SIDE: usize = SHADOW_MAP_SIDE as usize;
pub(crate) const TEXELS_PER_M: f32 = SIDE as f32 / SHADOW_MAP_WIDTH_M;
/// Resolution of heights, which are stored as 16-bit numbers of steps.
pub(crate) const STEPS_PER_M: f32 = SHADOW_DEPTH_LEVELS / (2.0 * SHADOW_HALF_DEPTH_M);
/// Height of the centre of the map, in steps.
pub(crate) const MIDDLE_STEPS: f32 = SHADOW_DEPTH_LEVELS / 2.0;
/// Maximum height, in steps. Higher geometry is clamped to it.
pub(crate) const MAX_HEIGHT: f32 = SHADOW_DEPTH_LEVELS - 1.0;
/// Height of empty texels, in steps.
pub(crate) const EMPTY_HEIGHT: f32 = 0.0;
/// Number of texels along each edge of a tile.
pub(crate) const TILE: usize = DepthTile::WIDTH as usize;
/// Number of tiles along each edge of a map.
pub(crate) const TILES: usize = SIDE / TILE;
/// Number of texels along each edge of a cell of the max-height pyramid.
pub(crate) const CELL: usize = 2;
/// Number of cells along each edge of a tile.
pub(crate) const CELLS_PER_TILE: usize = TILE / CELL;
/// Number of cells along each edge of a map.
pub(crate) const CELLS: usize = SIDE / CELL;
