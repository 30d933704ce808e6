//! The list of procedural surface patterns. The renderer draws each; here they are only names.

/// Declares the enum and, in the same order, the slice of all its variants, so that a new texture is named once.
macro_rules! textures {
    ($($name:ident)+) => {
        /// Procedural surface patterns; each is drawn from its own seed by the renderer.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[expect(missing_docs, reason = "the names say what is seen")]
        pub enum Texture {
            $($name),+
        }

        impl Texture {
            /// All, in the order of their numbers.
            pub const ALL: &[Self] = &[$(Self::$name),+];
        }
    };
}

textures! {
    Checker

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
    /// What a texture perturbation chooses from with equal chances: all but the floor's squares of 1 m, the first.
    pub const PERTURBATION: &[Self] = Self::ALL.split_at(1).1;
}
