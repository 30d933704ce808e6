//! The table of textures, with one file per family of patterns.

mod brick;
mod fabric;
mod geometric;
mod gradient;
mod metal;
mod mottled;
mod ornament;
mod stone;
mod tile;
mod wood;

use super::colour::TextureFn;
use scene::Texture::{self, *};

/// A texture, the side of its tile in m, and the constructor of its pattern.
type Entry = (Texture, f32, fn() -> TextureFn);

/// Returns the side of the tile, in m, and the pattern of a texture.
pub(crate) fn get(texture: Texture) -> (f32, TextureFn) {
    let (_, tile_m, pattern) = TABLE[texture as usize];
    (tile_m, pattern())
}

const TABLE: [Entry; Texture::ALL.len()] = [
    (FloorGrid, 1.0, geometric::floor_grid),
    (Cedar, 0.6, wood::cedar),
    (Maple, 0.8, wood::maple),
    (Wood, 1.2, wood::planks),
    (Barnwood, 0.6, wood::barnwood),
    (Parquet, 0.4, wood::parquet),
    (HerringboneFloor, 0.4, wood::herringbone_floor),
    (Walnut, 0.4, wood::walnut),
    (ButcherBlock, 0.24, wood::butcher_block),
    (Plywood, 0.2, wood::plywood),
    (Bamboo, 0.24, wood::bamboo),
    (RedBrick, 0.32, brick::red),
    (FlemishBrick, 0.32, brick::flemish),
    (WhiteBrick, 0.32, brick::white),
    (BasketBrick, 0.32, brick::basket),
    (CinderBlock, 0.4, brick::cinder_block),
    (SquareTile, 0.24, tile::square),
    (HexagonTile, 0.24, tile::hexagon),
    (OctagonTile, 0.2, tile::octagon),
    (MosaicTile, 0.24, tile::mosaic),
    (SubwayTile, 0.32, tile::subway),
    (FishScale, 0.24, tile::fish_scale),
    (Azulejo, 0.2, tile::azulejo),
    (Marble, 0.6, stone::marble),
    (GreenMarble, 0.5, stone::green_marble),
    (Granite, 0.25, stone::granite),
    (Slate, 0.4, stone::slate),
    (Terrazzo, 0.3, stone::terrazzo),
    (Cobble, 0.4, stone::cobble),
    (Sandstone, 0.5, stone::sandstone),
    (BrushedMetal, 0.4, metal::brushed),
    (DiamondPlate, 0.2, metal::diamond_plate),
    (Rust, 0.4, metal::rust),
    (Galvanised, 0.3, metal::galvanised),
    (Perforated, 0.15, metal::perforated),
    (Copper, 0.24, metal::copper),
    (Linen, 0.15, fabric::linen),
    (Denim, 0.15, fabric::denim),
    (Tweed, 0.15, fabric::tweed),
    (Tartan, 0.24, fabric::tartan),
    (Felt, 0.3, fabric::felt),
    (Knit, 0.16, fabric::knit),
    (Corduroy, 0.15, fabric::corduroy),
    (Leather, 0.2, fabric::leather),
    (Sunset, 0.3, gradient::sunset),
    (Ocean, 0.4, gradient::ocean),
    (Glow, 0.3, gradient::glow),
    (Rainbow, 0.4, gradient::rainbow),
    (Stripes, 0.24, geometric::stripes),
    (Gingham, 0.16, geometric::gingham),
    (PolkaDots, 0.2, geometric::polka_dots),
    (Chevrons, 0.24, geometric::chevrons),
    (Zigzags, 0.24, geometric::zigzags),
    (Rings, 0.2, geometric::rings),
    (Houndstooth, 0.2, geometric::houndstooth),
    (Maze, 0.24, geometric::maze),
    (Arcs, 0.24, geometric::arcs),
    (Waves, 0.24, geometric::waves),
    (Stars, 0.2, ornament::stars),
    (Flowers, 0.2, ornament::flowers),
    (Argyle, 0.2, ornament::argyle),
    (Triangles, 0.24, ornament::triangles),
    (Cubes, 0.2, ornament::cubes),
    (Lattice, 0.2, ornament::lattice),
    (Plaster, 1.0, mottled::plaster),
    (Clouds, 0.5, mottled::clouds),
    (Speckle, 0.2, mottled::speckle),
    (Camouflage, 0.4, mottled::camouflage),
    (StainedGlass, 0.3, mottled::stained_glass),
    (Leopard, 0.24, mottled::leopard),
    (Zebra, 0.3, mottled::zebra),
    (Cork, 0.24, mottled::cork),
    (RollerPaint, 0.3, mottled::roller_paint),
    (ChippedPaint, 0.4, mottled::chipped_paint),
];

// The discriminant of a texture is its index in the table.
const _: () = {
    let mut i = 0;
    while i < TABLE.len() {
        assert!(TABLE[i].0 as usize == i, "the table must be in the order of `Texture`");
        i += 1;
    }
};
