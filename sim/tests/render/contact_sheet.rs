//! Contact sheets: composition and PNG output.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use ipc_types::ImageSize;
use sim::show::contact_sheet::{Panel, SheetError, compose};

fn panel(caption: &str, (side, rgb): (usize, Vec<u8>)) -> Panel {
    Panel { caption: caption.to_owned(), images: vec![(ImageSize::square(side), rgb)] }
}

#[test]
fn captions_differ_and_leave_images_unchanged() {
    let [plain, one, other] =
        ["", "step 1", "step 2"].map(|caption| compose(&[panel(caption, (64, vec![7; 64 * 64 * 3]))], 1, 1));
    let [width, height] = plain.size();
    assert_eq!(one.size(), other.size());
    assert!(one.size()[0] == width && one.size()[1] > height);
    let n_image = width * (height - 4);
    assert!(one.pixels().take(n_image).eq(plain.pixels().take(n_image)));
    let n_text = |sheet: &sim::show::contact_sheet::RgbImage| {
        sheet.pixels().skip(n_image).filter(|rgb| *rgb == [255; 3]).count()
    };
    assert!(n_text(&one) > 30 && n_text(&plain) == 0);
    assert!(!one.pixels().eq(other.pixels()));
}

#[test]
fn sheet_contains_its_images_enlarged() {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("sheet.png");
    let (red, blue) = ([255, 0, 0].repeat(9), [0, 0, 255].repeat(4));
    let panels = [(3, red), (2, blue.clone()), (2, blue)].map(|image| panel("", image));
    compose(&panels, 2, 2).write_png(&path).unwrap();
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
    let error = compose(&[panel("", (1, vec![0; 3]))], 1, 1).write_png(&path).unwrap_err();
    assert!(matches!(error, SheetError::Create { .. }));
    assert!(error.to_string().contains("sheet.png"), "{error}");
}
