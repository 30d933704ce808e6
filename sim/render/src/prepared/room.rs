//! Instances of the room: table, floor and walls (docs/benchmark.md, "Scenes and objects" and
//! "Perturbations").
//!
//! The table's collision shape is a block; the rendered table is a top on four legs with the same upper face.

use core::f32::consts::FRAC_1_SQRT_2;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::instance::{Anchor, Fixture, Instance, MeshSource};
use super::material::Material;
use crate::mesh::MeshId;
use scene::{Appearance, Scene, Table, TableKind};

/// World z of the floor, in m.
const FLOOR_Z: f32 = -0.9196;
/// Half the side of the rendered square of floor, in m.
const FLOOR_HALF: f32 = 50.0;

/// A table whose upper face is centred at `centre` with half extents `half`. World coordinates, in m.
struct Bench {
    centre: [f32; 2],
    half: [f32; 2],
    top_z: f32,
    foot_z: f32,
    thickness: f32,
}

const SINGLE_ARM: Bench =
    Bench { centre: [-0.12, 0.0], half: [0.6045, 1.209], top_z: 0.0, foot_z: FLOOR_Z, thickness: 0.045 };
const BIMANUAL: Bench =
    Bench { centre: [0.0, 0.0], half: [0.6, 0.8], top_z: 0.825, foot_z: SINGLE_ARM.top_z, thickness: 0.05 };

/// Half the side of a leg, in m.
const LEG_HALF: f32 = 0.03;
/// Distance from the edge of the table to the centre of a leg, in m.
const LEG_INSET: f32 = 0.07;
/// Height of the frame under the top, in m.
const FRAME_HEIGHT: f32 = 0.07;

/// Returns the world z of the upper face of the table, in m.
pub(crate) const fn table_top_z(kind: TableKind) -> f32 {
    match kind {
        TableKind::SingleArm | TableKind::SingleArmTurned => SINGLE_ARM.top_z,
        TableKind::Bimanual => BIMANUAL.top_z,
    }
}

/// Appends table, walls and floor.
pub(crate) fn push(scene: &Scene, instances: &mut Vec<Instance>) {
    let top = &scene.table.top;
    let mut push = |bench: &Bench, top: &Appearance| push_bench(bench, top, &scene.table, instances);
    match scene.table.kind {
        TableKind::SingleArm => push(&SINGLE_ARM, top),
        TableKind::SingleArmTurned => {
            let [x, y] = SINGLE_ARM.half;
            push(&Bench { half: [y, x], ..SINGLE_ARM }, top);
        }
        TableKind::Bimanual => {
            push(&BIMANUAL, top);
            push(&SINGLE_ARM, scene.table.lower_top.as_ref().unwrap_or(top));
        }
    }
    if let Some(appearance) = scene.background.walls {
        // Four walls at x, y = ±1.5 m, each 3 m long and 0.1 m thick, from z = −0.92 m to 1.08 m.
        for side in [-1.5, 1.5] {
            instances.push(block(Fixture::Walls, [side, 0.0, 0.08], [0.05, 1.5, 1.0], appearance.into()));
            instances.push(block(Fixture::Walls, [0.0, side, 0.08], [1.5, 0.05, 1.0], appearance.into()));
        }
    }
    let floor = [0.0, 0.0, FLOOR_Z];
    let (half, material) = ([FLOOR_HALF, FLOOR_HALF, 1.0], scene.background.floor.into());
    instances.push(placed(Fixture::Floor, MeshId::Quad, floor, half, material));
}

fn push_bench(bench: &Bench, top: &Appearance, table: &Table, instances: &mut Vec<Instance>) {
    let [top, legs] = [*top, table.legs].map(Material::from);
    let Bench { centre: [x, y], half: [hx, hy], top_z, foot_z, thickness } = *bench;
    if table.as_block && foot_z == FLOOR_Z {
        let half = [hx, hy, (top_z - foot_z) / 2.0];
        instances.push(block(Fixture::Table, [x, y, f32::midpoint(top_z, foot_z)], half, top));
        return;
    }
    let under_z = top_z - thickness;
    let mut push = |centre, half| instances.push(block(Fixture::Table, centre, half, legs));
    let (leg_x, leg_y) = (hx - LEG_INSET, hy - LEG_INSET);
    let (rail, rail_z) = (FRAME_HEIGHT / 2.0, under_z - FRAME_HEIGHT / 2.0);
    for side in [-1.0, 1.0] {
        push([x + side * leg_x, y, rail_z], [LEG_HALF / 2.0, leg_y - LEG_HALF, rail]);
        push([x, y + side * leg_y, rail_z], [leg_x - LEG_HALF, LEG_HALF / 2.0, rail]);
        for end in [-1.0, 1.0] {
            let foot = [x + side * leg_x, y + end * leg_y, f32::midpoint(under_z, foot_z)];
            push(foot, [LEG_HALF, LEG_HALF, (under_z - foot_z) / 2.0]);
        }
    }
    let top_half = [hx, hy, thickness / 2.0];
    let mut top = block(Fixture::Table, [x, y, top_z - thickness / 2.0], top_half, top);
    if table.kind == TableKind::SingleArmTurned {
        // A quarter turn about z, for the grain of the wood turns with the table.
        let turn = UnitQuaternion::new_unchecked(Quaternion::new(FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2));
        top.pose = Isometry3::from_parts(Translation3::from(top.pose.translation), turn);
        top.scale = [hy, hx, thickness / 2.0];
    }
    instances.push(top);
}

fn block(fixture: Fixture, centre: [f32; 3], half: [f32; 3], material: Material) -> Instance {
    placed(fixture, MeshId::Box, centre, half, material)
}

fn placed(fixture: Fixture, mesh: MeshId, centre: [f32; 3], scale: [f32; 3], material: Material) -> Instance {
    let ([x, y, z], mesh) = (centre, MeshSource::Library(mesh));
    Instance { mesh, anchor: Anchor::World(fixture), pose: Isometry3::translation(x, y, z), scale, material }
}
