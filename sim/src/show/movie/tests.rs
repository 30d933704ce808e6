//! A movie, decoded again and put together frame upon frame, is what went in.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use super::{Format, Movie};
use crate::show::contact_sheet::{RgbImage, compose};

/// A square of 40 colours on black that wanders, 3 frames.
fn frames() -> Vec<RgbImage> {
    let frame = |at: usize| {
        let mut image = vec![[0; 3]; 32 * 32];
        for place in 0..64 {
            let (x, y) = (place % 8 + at, place / 8 + 2 * at);
            image[y * 32 + x] = [255 - 6 * (place as u8 % 40), 17, place as u8 % 40];
        }
        compose(&[(32, image.concat())], 1, 1)
    };
    [0, 3, 7].map(frame).into()
}

fn write(format: Format, path: &Path) {
    let mut frames = frames().into_iter();
    let mut movie = Movie::begin(path, format, 3, frames.next().unwrap()).unwrap();
    frames.for_each(|frame| movie.push(frame).unwrap());
    assert!(!path.exists(), "the file has its name before it is whole");
    movie.finish().unwrap();
}

/// Puts `[n, 4] u8` RGBA, opaque or transparent, over a canvas.
fn over(canvas: &mut [[u8; 3]], rgba: &[u8]) {
    for (below, above) in canvas.iter_mut().zip(rgba.as_chunks::<4>().0) {
        if above[3] == u8::MAX {
            *below = [above[0], above[1], above[2]];
        }
    }
}

/// The decoded frames, put over each other in turn, against those that were written.
fn assert_same(mut next: impl FnMut() -> Vec<u8>) {
    let frames = frames();
    let mut canvas = vec![[1; 3]; frames[0].pixels().count()];
    for frame in &frames {
        over(&mut canvas, &next());
        assert!(frame.pixels().eq(canvas.iter().copied()));
    }
}

#[test]
fn an_animated_png_is_exact() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.png");
    write(Format::Apng, &path);
    let mut reader = png::Decoder::new(BufReader::new(File::open(&path).unwrap())).read_info().unwrap();
    let control = *reader.info().frame_control().unwrap();
    assert_eq!((control.delay_num, control.delay_den), (1, 20));
    assert_same(|| {
        let mut rgba = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut rgba).unwrap();
        rgba
    });
}

#[test]
fn a_gif_of_few_colours_is_exact() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.gif");
    write(Format::Gif, &path);
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(File::open(&path).unwrap()).unwrap();
    assert_same(|| decoder.read_next_frame().unwrap().unwrap().buffer.to_vec());
}

#[test]
fn an_unfinished_movie_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    for format in [Format::Apng, Format::Gif] {
        let movie = Movie::begin(&dir.path().join("x"), format, 3, frames().remove(0)).unwrap();
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        drop(movie);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    }
}

#[test]
fn a_format_is_known_by_its_extension() {
    assert_eq!(Format::of(Path::new("a/b.GIF")), Ok(Format::Gif));
    assert_eq!(Format::of(Path::new("b.apng")), Ok(Format::Apng));
    for unknown in ["a/b.mp4", "gif", "a.gif.part"] {
        let error = Format::of(Path::new(unknown)).unwrap_err();
        assert_eq!(error.to_string(), format!("{unknown}: a movie's name ends in .png, .apng, .gif"));
    }
}
