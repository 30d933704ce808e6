// Output of placement.wgsl for compute.wgsl: lists of blocks of triangles, for images and for shadow maps.

@group(0) @binding(4) var<storage, read_write> image_blocks: BlockList;
@group(0) @binding(5) var<storage, read_write> map_blocks: BlockList;

const TRIANGLES_PER_BLOCK: u32 = 64u;

struct BlockList {
    n: atomic<u32>,
    padding: u32,
    // Instance index and first triangle. The order differs from run to run, which no image depends on.
    blocks: array<vec2u>,
}

fn list_instance(view: View, instance_idx: u32, source: SceneInstance, is_shown: bool) {
    if !is_shown {
        return;
    }
    let n_blocks = (source.n_triangles + TRIANGLES_PER_BLOCK - 1u) / TRIANGLES_PER_BLOCK;
    if view.is_shadow_map == 1u {
        let first = atomicAdd(&map_blocks.n, n_blocks);
        for (var i = 0u; i < n_blocks; i++) {
            map_blocks.blocks[first + i] = vec2u(instance_idx, i * TRIANGLES_PER_BLOCK);
        }
    } else {
        let first = atomicAdd(&image_blocks.n, n_blocks);
        for (var i = 0u; i < n_blocks; i++) {
            image_blocks.blocks[first + i] = vec2u(instance_idx, i * TRIANGLES_PER_BLOCK);
        }
    }
}
