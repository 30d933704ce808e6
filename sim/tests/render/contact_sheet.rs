//! Contact sheets: composition and PNG output.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use sim::show::contact_sheet::{SheetError, compose};

#[test]
fn sheet_contains_its_images_enlarged() {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("sheet.png");
    let (red, blue) = ([255, 0, 0].repeat(9), [0, 0, 255].repeat(4));
    compose(&[(3, &red), (2, &blue), (2, &blue)], 2, 2).write_png(&path).unwrap();
    let mut reader = png::Decoder::new(BufReader::new(File::open(&path).unwrap())).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let count = |rgb: [u8; 3]| bytes.chunks_exact(3).filter(|p| **p == rgb).count();
    // Two columns and two rows of cells, each as large as the largest image.
    assert_eq!(info.width, info.height);
    assert_eq!([count([255, 0, 0]), count([0, 0, 255])], [9 * 4, 2 * 4 * 4]);
}

#[test]
fn unwritable_sheet_names_its_file() {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("missing").join("sheet.png");
    let error = compose(&[(1, [0; 3])], 1, 1).write_png(&path).unwrap_err();
    assert!(matches!(error, SheetError::Create { .. }));
    assert!(error.to_string().contains("sheet.png"), "{error}");
}
