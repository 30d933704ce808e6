//! Meshing of signed distance fields by naive surface nets (Gibson, "Constrained elastic surface nets",
//! 1998).
//!
//! Every cell that the surface crosses gets one vertex, which is projected onto the surface along the
//! gradient. The gradient is also its normal. The crate `fast-surface-nets` sees only sampled distances: its
//! vertices are means of crossings and its normals differences of samples, so every vertex would move.

use super::SignedDistanceField;
use crate::math::affine::{Vec3, add, dot, normalised, scaled, sub};
use crate::mesh::Mesh;

/// Newton iterations that project a vertex onto the surface.
const N_ITERATIONS: usize = 4;

/// Meshes the surface inside the box from `min` to `max` with cells of side `cell_m`.
pub(crate) fn mesh(field: &SignedDistanceField<'_>, min: Vec3, max: Vec3, cell_m: f32) -> Mesh {
    surface(field, min, max, cell_m).finish()
}

/// Meshes the part of the surface on which `region` is positive, raised by `offset_m`: an open sheet that
/// covers that part of the mesh which [`mesh`] returns for the same arguments.
pub(crate) fn sheet(
    field: &SignedDistanceField<'_>,
    (min, max, cell_m): (Vec3, Vec3, f32),
    offset_m: f32,
    region: &dyn Fn(Vec3) -> f32,
) -> Mesh {
    let whole = surface(field, min, max, cell_m);
    let mut sheet = Mesh::default();
    for triangle in &whole.triangles {
        let corners = triangle.map(|i| {
            let position = whole.position(i);
            (position, whole.normals[i as usize], region(position))
        });
        // Sutherland-Hodgman clipping by the zero of the region's function.
        let mut polygon = Vec::with_capacity(4);
        for (i, (position, normal, inside)) in corners.iter().enumerate() {
            let (next_position, next_normal, next_inside) = &corners[(i + 1) % 3];
            if *inside > 0.0 {
                polygon.push((*position, *normal));
            }
            if (*inside > 0.0) != (*next_inside > 0.0) {
                let t = inside / (inside - next_inside);
                let between = |a: Vec3, b: Vec3| add(a, scaled(sub(b, a), t));
                polygon
                    .push((between(*position, *next_position), normalised(between(*normal, *next_normal))));
            }
        }
        let vertices: Vec<u32> = polygon
            .into_iter()
            .map(|(position, normal)| sheet.push(add(position, scaled(normal, offset_m)), normal))
            .collect();
        for i in 2..vertices.len() {
            sheet.triangle([vertices[0], vertices[i - 1], vertices[i]]);
        }
    }
    sheet.finish()
}

fn surface(field: &SignedDistanceField<'_>, min: Vec3, max: Vec3, cell_m: f32) -> Mesh {
    let grid = Grid::new(field, min, max, cell_m);
    let mut mesh = Mesh::default();
    let mut vertex_of_cell = vec![None; grid.distances.len()];
    for node in grid.nodes() {
        let corners = || (0..8).map(|c| shifted(node, [c & 1, c >> 1 & 1, c >> 2 & 1]));
        if node.iter().zip(grid.size).any(|(i, n)| i + 1 >= n) || !crosses(corners().map(|c| grid.at(c))) {
            continue;
        }
        let centre = add(grid.position(node), [cell_m / 2.0; 3]);
        let position = project_to_surface(field, centre, cell_m);
        vertex_of_cell[grid.index(node)] = Some(mesh.push(position, normalised(field.gradient(position))));
    }
    for node in grid.nodes() {
        for axis in 0..3 {
            let mut step = [0; 3];
            step[axis] = 1;
            let far = shifted(node, step);
            if far[axis] >= grid.size[axis] || (grid.at(node) < 0.0) == (grid.at(far) < 0.0) {
                continue;
            }
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let around = [(1, 1), (0, 1), (0, 0), (1, 0)].map(|(du, dv)| {
                let mut cell = node;
                cell[u] -= du;
                cell[v] -= dv;
                vertex_of_cell[grid.index(cell)]
                    .expect("the surface crosses all four cells around a crossed edge")
            });
            let [a, b, c, d] = around;
            mesh.quad(if grid.at(node) < 0.0 { [a, b, c, d] } else { [d, c, b, a] });
        }
    }
    mesh
}

/// Distances sampled on a grid that covers the box plus a margin of two cells.
struct Grid {
    origin: Vec3,
    cell_m: f32,
    size: [usize; 3],
    distances: Vec<f32>,
}

impl Grid {
    fn new(field: &SignedDistanceField<'_>, min: Vec3, max: Vec3, cell_m: f32) -> Self {
        let size = core::array::from_fn(|i| ((max[i] - min[i]) / cell_m) as usize + 6);
        let origin = sub(min, [2.0 * cell_m; 3]);
        let mut grid = Self { origin, cell_m, size, distances: Vec::new() };
        grid.distances = grid.nodes().map(|node| field.distance(grid.position(node))).collect();
        grid
    }

    fn nodes(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [nx, ny, nz] = self.size;
        (0..nx * ny * nz).map(move |i| [i % nx, i / nx % ny, i / nx / ny])
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    fn at(&self, node: [usize; 3]) -> f32 {
        self.distances[self.index(node)]
    }

    fn position(&self, node: [usize; 3]) -> Vec3 {
        core::array::from_fn(|i| self.origin[i] + node[i] as f32 * self.cell_m)
    }
}

fn shifted(node: [usize; 3], by: [usize; 3]) -> [usize; 3] {
    core::array::from_fn(|i| node[i] + by[i])
}

fn crosses(mut distances: impl Iterator<Item = f32>) -> bool {
    let inside = distances.next().is_some_and(|d| d < 0.0);
    distances.any(|d| (d < 0.0) != inside)
}

/// Returns the zero of the field closest to the centre of a cell, clamped to slightly more than the cell.
fn project_to_surface(field: &SignedDistanceField<'_>, centre: Vec3, cell_m: f32) -> Vec3 {
    let mut p = centre;
    for _ in 0..N_ITERATIONS {
        let gradient = field.gradient(p);
        let steepness = dot(gradient, gradient).max(1e-3);
        p = sub(p, scaled(gradient, field.distance(p) / steepness));
        for i in 0..3 {
            p[i] = p[i].clamp(centre[i] - 0.6 * cell_m, centre[i] + 0.6 * cell_m);
        }
    }
    p
}
