//! Generates `layout.py` of the Python package from the Rust types and asserts that the committed file is
//! identical.

#![expect(clippy::unwrap_used, reason = "tests fail by panicking")]

use std::fmt::Write as _;
use std::mem::offset_of;
use std::path::Path;

use iceoryx2::prelude::ZeroCopySend;
use ipc_types::layout::{
    EXTERNAL_OFFSET, INSTRUCTION_BYTES, MAX_ACTION_DIM, MAX_HORIZON, MAX_STATE_DIM, PAGE_BYTES, SCHEMA,
    SCHEMA_HASH,
};
use ipc_types::{
    ActionBlock, ActionHeader, ControlMode, EnvRecord, ImageSize, ImageSizes, Morphology, ObservationHeader,
    Page,
};

/// Environment variable that makes the test write the module before the comparison.
const BLESS: &str = "HYPOGEUM_BLESS";

/// A struct field: name, Python type, byte offset.
type LayoutField = (&'static str, &'static str, usize);

macro_rules! fields {
    ($type:ty: $($field:ident as $python:literal),+ $(,)?) => {
        vec![$((stringify!($field), $python, offset_of!($type, $field))),+]
    };
}

#[test]
fn python_layout_matches_rust_types() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../python/hypogeum/layout.py");
    let expected = module();
    if std::env::var_os(BLESS).is_some() {
        std::fs::write(&path, &expected).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == expected,
        "python/hypogeum/layout.py differs from the layout in ipc-types; update it with \
         `{BLESS}=1 cargo test -p ipc-types --test python_layout`"
    );
}

fn module() -> String {
    let mut out = String::new();
    out.push_str(
        r#""""Wire layout of the link, byte by byte. All numbers are little-endian.

Generated from ipc-types. To update it, run `HYPOGEUM_BLESS=1 cargo test -p ipc-types --test python_layout`.

An observation message consists of `n_envs` blocks of whole pages, one per env. A block holds an `ENV_RECORD` (one page)
and, if the lane has images, the external images `[2, height, width, 3] u8`, followed by the hand images
`[n_arms, height, width, 3] u8`, both of the sizes in the header. An action message consists of one `ACTION_BLOCK` (two pages) per env.
"""

import ctypes
from ctypes import c_uint8, c_uint16, c_uint32, c_uint64
from typing import NamedTuple

import numpy as np

"#,
    );
    schema(&mut out);
    constants(&mut out);
    robots(&mut out);
    messages(&mut out);
    records(&mut out);
    out
}

fn schema(out: &mut String) {
    out.push_str("# Description of the layout in one line. Both sides check its hash.\nSCHEMA = (\n");
    for part in SCHEMA.split_inclusive("; ") {
        for piece in split_at_width(part, 108) {
            writeln!(out, "    {piece:?}").unwrap();
        }
    }
    writeln!(out, ")\n# xxh3-64 of `SCHEMA`.\nSCHEMA_HASH = {SCHEMA_HASH:#018x}\n").unwrap();
}

/// Splits `text` after commas into pieces of at most `width` bytes.
fn split_at_width(text: &str, width: usize) -> Vec<String> {
    let mut pieces = vec![String::new()];
    for word in text.split_inclusive(", ") {
        if pieces.last().unwrap().len() + word.len() > width {
            pieces.push(String::new());
        }
        pieces.last_mut().unwrap().push_str(word);
    }
    pieces
}

fn constants(out: &mut String) {
    let table: [(&str, usize, &str); 7] = [
        ("PAGE_BYTES", PAGE_BYTES, "Size of a page, the element of every message."),
        ("MIN_IMAGE_SIDE", ImageSize::MIN.width, "Smallest width and height of an image in pixels."),
        ("EXTERNAL_OFFSET", EXTERNAL_OFFSET, "Byte offset of the first external image in an env's block."),
        ("INSTRUCTION_BYTES", INSTRUCTION_BYTES, "Maximum length of an instruction in UTF-8 bytes."),
        ("MAX_STATE_DIM", MAX_STATE_DIM, "Maximum width of a state vector."),
        ("MAX_ACTION_DIM", MAX_ACTION_DIM, "Maximum width of an action row."),
        ("MAX_HORIZON", MAX_HORIZON, "Maximum number of rows in an action chunk."),
    ];
    for (name, value, comment) in table {
        writeln!(out, "{name} = {value}  # {comment}").unwrap();
    }
    let ImageSizes { external, hand } = ImageSizes::BENCHMARK;
    let sizes = [external, hand].map(|size| format!("({}, {})", size.width, size.height)).join(", ");
    writeln!(
        out,
        "IMAGE_SIZES = ({sizes})  # The benchmark's sizes of external and hand images, (width, height)."
    )
    .unwrap();
    let ImageSize { width, height } = ImageSize::MAX;
    writeln!(out, "MAX_IMAGE_SIZE = ({width}, {height})  # Largest width and height of an image.").unwrap();
}

/// Formats a Python tuple, on several lines if it is long.
fn tuple(items: impl Iterator<Item = String>) -> String {
    let one_line = items.collect::<Vec<_>>().join(", ");
    if one_line.len() <= 90 {
        return format!("({one_line})");
    }
    let lines = split_at_width(&one_line, 90);
    format!("(\n            {}\n        )", lines.join("\n            ")).replace(" \n", "\n")
}

fn robots(out: &mut String) {
    out.push_str(
        r#"

class Morphology(NamedTuple):
    """Robot set-up of the benchmark: one arm or two."""

    name: str
    n_arms: int
    n_external_cameras: int
    n_hand_cameras: int
    cameras: tuple  # names in the order of their images: external, then hand
    state_dim: int
    state_parts: tuple  # (name, width) pairs in the order of the state vector
    default_control_mode: str
    action_dim: dict  # width of an action row by control mode


# Keyed by name, in the order of the wire codes.
MORPHOLOGIES = {
"#,
    );
    for morphology in Morphology::ALL {
        let widths =
            ControlMode::ALL.map(|mode| format!("{:?}: {}", mode.name(), mode.action_dim(morphology)));
        writeln!(
            out,
            "    {name:?}: Morphology(\n        {name:?}, n_arms={}, n_external_cameras={}, n_hand_cameras={}, \
             state_dim={},\n        cameras={},\n        state_parts={},\n        default_control_mode={:?},\n        action_dim={{{}}},\n    ),",
            morphology.n_arms(),
            morphology.n_external_cameras(),
            morphology.n_hand_cameras(),
            morphology.state_dim(),
            tuple(morphology.camera_names().iter().map(|name| format!("{name:?}"))),
            tuple(morphology.state_parts().iter().map(|(name, width)| format!("({name:?}, {width})"))),
            morphology.default_control_mode().name(),
            widths.join(", "),
            name = morphology.name(),
        )
        .unwrap();
    }
    let modes = ControlMode::ALL.map(|mode| format!("{:?}", mode.name()));
    writeln!(out, "}}\n# In the order of the wire codes.\nCONTROL_MODES = ({})", modes.join(", ")).unwrap();
}

fn messages(out: &mut String) {
    let observation = fields!(ObservationHeader:
        schema_hash as "c_uint64", run as "c_uint64", sequence as "c_uint64", epoch as "c_uint32",
        n_envs as "c_uint32", block_pages as "c_uint32", morphology as "c_uint32", control_mode as "c_uint32",
        images as "c_uint32", has_checksum as "c_uint32", checksum as "c_uint32", image_sizes as "c_uint16 * 4");
    let action = fields!(ActionHeader:
        schema_hash as "c_uint64", run as "c_uint64", sequence as "c_uint64", epoch as "c_uint32",
        n_envs as "c_uint32", status as "c_uint32", has_checksum as "c_uint32", checksum as "c_uint32",
        reserved as "c_uint32 * 5");
    let page = vec![("bytes", "c_uint8 * PAGE_BYTES", offset_of!(Page, 0))];
    structure::<Page>(out, "Page", "Page of shared memory, the element of every message.", &page);
    structure::<ObservationHeader>(
        out,
        "ObservationHeader",
        "Header of an observation message.",
        &observation,
    );
    structure::<ActionHeader>(
        out,
        "ActionHeader",
        "Header of an action message. Status 0 is success, 2 a damaged observation, any other a failed policy.",
        &action,
    );
}

/// Writes a ctypes structure with its iceoryx2 type name.
fn structure<T: ZeroCopySend>(out: &mut String, name: &str, doc: &str, fields: &[LayoutField]) {
    // SAFETY: the function only returns the type's name.
    let type_name = unsafe { <T as ZeroCopySend>::type_name() };
    writeln!(out, "\n\nclass {name}(ctypes.Structure):\n    \"\"\"{doc} {} bytes.\"\"\"\n", size_of::<T>())
        .unwrap();
    out.push_str("    _fields_ = [\n");
    for (field, python, offset) in fields {
        writeln!(out, "        ({field:?}, {python}),  # at {offset}").unwrap();
    }
    writeln!(out, "    ]\n\n    @staticmethod\n    def type_name():\n        return {type_name:?}").unwrap();
}

fn records(out: &mut String) {
    let record = fields!(EnvRecord:
        slot as "\"<u4\"", query as "\"<u4\"", step as "\"<u4\"", state_dim as "\"<u4\"",
        instruction_len as "\"<u4\"", execute as "\"<u4\"", policy_seed as "\"<u8\"",
        state as "(\"<f4\", MAX_STATE_DIM)", instruction as "(\"u1\", INSTRUCTION_BYTES)");
    let block = fields!(ActionBlock:
        slot as "\"<u4\"", query as "\"<u4\"", n_rows as "\"<u4\"", action_dim as "\"<u4\"",
        rows as "(\"<f4\", MAX_HORIZON * MAX_ACTION_DIM)");
    dtype::<EnvRecord>(
        out,
        "ENV_RECORD",
        "First page of an env's block: everything a policy observes except the images.",
        &record,
    );
    dtype::<ActionBlock>(
        out,
        "ACTION_BLOCK",
        "Answer for one env. Its rows are packed: `[n_rows, action_dim]`.",
        &block,
    );
}

/// Writes a numpy dtype. Bytes that no field covers are zero.
fn dtype<T>(out: &mut String, name: &str, doc: &str, fields: &[LayoutField]) {
    writeln!(out, "\n\n# {doc}\n{name} = np.dtype({{").unwrap();
    let join = |each: fn(&LayoutField) -> String| fields.iter().map(each).collect::<Vec<_>>();
    for (key, values) in [
        ("names", join(|field| format!("{:?}", field.0))),
        ("formats", join(|field| field.1.to_owned())),
        ("offsets", join(|field| field.2.to_string())),
    ] {
        let line = format!("    {key:?}: [{}],", values.join(", "));
        if line.len() <= 120 {
            writeln!(out, "{line}").unwrap();
        } else {
            writeln!(out, "    {key:?}: [\n        {},\n    ],", values.join(", ")).unwrap();
        }
    }
    writeln!(out, "    \"itemsize\": {},\n}})", size_of::<T>()).unwrap();
}
