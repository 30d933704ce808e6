//! Names of the procedural surface textures. The renderer generates their texels.

/// Declares the enum and the slice of all its variants, in the same order, so that a new texture is added in
/// one place.
macro_rules! textures {
    ($($name:ident)+) => {
        /// A procedural surface texture.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[expect(missing_docs, reason = "the variants are named after the depicted material or pattern")]
        pub enum Texture {
            $($name),+
        }

        impl Texture {
            /// All textures, in the order of their discriminants.
            pub const ALL: &[Self] = &[$(Self::$name),+];
        }
    };
}

textures! {
    FloorGrid Cedar Maple

    Wood Barnwood Parquet HerringboneFloor Walnut ButcherBlock Plywood Bamboo

    RedBrick FlemishBrick WhiteBrick BasketBrick CinderBlock

    SquareTile HexagonTile OctagonTile MosaicTile SubwayTile FishScale Azulejo

    Marble GreenMarble Granite Slate Terrazzo Cobble Sandstone

    BrushedMetal DiamondPlate Rust Galvanised Perforated Copper

    Linen Denim Tweed Tartan Felt Knit Corduroy Leather

    Sunset Ocean Glow Rainbow

    Stripes Gingham PolkaDots Chevrons Zigzags Rings Houndstooth Maze Arcs Waves

    Stars Flowers Argyle Triangles Cubes Lattice

    Plaster Clouds Speckle Camouflage StainedGlass Leopard Zebra Cork

    RollerPaint ChippedPaint
}

impl Texture {
    /// Textures from which the texture perturbations choose uniformly: all but those of the floor and of the
    /// two tables.
    pub const PERTURBATION: &[Self] = Self::ALL.split_at(3).1;
}
