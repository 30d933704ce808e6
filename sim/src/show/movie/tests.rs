//! Round-trip tests: a decoded movie equals the frames that were encoded.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use ipc_types::ImageSize;

use super::mp4::Mp4;
use super::{MovieFormat, MovieWriter};
use crate::show::contact_sheet::{Panel, RgbImage, compose};

/// Returns three frames of a moving square with 40 colours on black.
fn frames() -> Vec<RgbImage> {
    let frame = |shift: usize| {
        let mut image = vec![[0; 3]; 32 * 32];
        for i in 0..64 {
            let (x, y) = (i % 8 + shift, i / 8 + 2 * shift);
            image[y * 32 + x] = [255 - 6 * (i as u8 % 40), 17, i as u8 % 40];
        }
        compose(
            &[Panel { caption: String::new(), images: vec![(ImageSize::square(32), image.concat())] }],
            1,
            1,
        )
    };
    [0, 3, 7].map(frame).into()
}

fn write(format: MovieFormat, path: &Path) {
    let mut frames = frames().into_iter();
    let mut movie = MovieWriter::begin(path, format, 3, 1, frames.next().unwrap()).unwrap();
    frames.for_each(|frame| movie.push(frame).unwrap());
    assert!(!path.exists(), "the file appears under its final path before it is complete");
    movie.finish().unwrap();
}

/// Composites `[n, 4] u8` RGBA pixels, each opaque or transparent, over a canvas.
fn composite(canvas: &mut [[u8; 3]], rgba: &[u8]) {
    for (below, above) in canvas.iter_mut().zip(rgba.as_chunks::<4>().0) {
        if above[3] == u8::MAX {
            *below = [above[0], above[1], above[2]];
        }
    }
}

/// Composites the decoded frames in order and compares each result with the frame that was encoded.
fn assert_round_trip(mut next: impl FnMut() -> Vec<u8>) {
    let frames = frames();
    let mut canvas = vec![[1; 3]; frames[0].pixels().count()];
    for frame in &frames {
        composite(&mut canvas, &next());
        assert!(frame.pixels().eq(canvas.iter().copied()));
    }
}

#[test]
fn animated_png_is_lossless() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.png");
    write(MovieFormat::Apng, &path);
    let mut reader = png::Decoder::new(BufReader::new(File::open(&path).unwrap())).read_info().unwrap();
    let control = *reader.info().frame_control().unwrap();
    assert_eq!((control.delay_num, control.delay_den), (1, 20));
    assert_round_trip(|| {
        let mut rgba = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut rgba).unwrap();
        rgba
    });
}

#[test]
fn gif_with_few_colors_is_lossless() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.gif");
    write(MovieFormat::Gif, &path);
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(File::open(&path).unwrap()).unwrap();
    assert_round_trip(|| decoder.read_next_frame().unwrap().unwrap().buffer.to_vec());
}

#[test]
fn gif_with_many_colors_is_close() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.gif");
    let (mut image, side) = (Vec::new(), 64);
    for i in 0..side * side {
        image.extend([(i % side / 2 * 8) as u8, (i / side / 2 * 8) as u8, 90]);
    }
    let images = vec![(ImageSize::square(side), image)];
    let frame = compose(&[Panel { caption: String::new(), images }], 1, 1);
    MovieWriter::begin(&path, MovieFormat::Gif, 1, 1, frame.clone()).unwrap().finish().unwrap();
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(File::open(&path).unwrap()).unwrap();
    let decoded = decoder.read_next_frame().unwrap().unwrap().buffer.to_vec();
    let (mut decoded_as, mut errors) = (BTreeMap::new(), Vec::new());
    for (found, expected) in decoded.as_chunks::<4>().0.iter().zip(frame.pixels()) {
        errors.push((0..3).map(|c| found[c].abs_diff(expected[c])).max().unwrap());
        assert_eq!(decoded_as.entry(expected).or_insert(*found), found, "{expected:?} is dithered");
    }
    // A quarter of the colours have to do for all of them, which are 8 codes apart.
    let mean = errors.iter().map(|error| f64::from(*error)).sum::<f64>() / errors.len() as f64;
    assert!(mean < 8.0, "mean {mean}");
}

#[test]
fn mp4_without_ffmpeg_says_what_to_do() {
    let dir = tempfile::tempdir().unwrap();
    let begin = |program: &Path| Mp4::begin(program, &dir.path().join("x.mp4"), 1, &frames()[0]);
    let error = begin(&dir.path().join("ffmpeg")).err().unwrap().to_string();
    assert!(error.contains("apt install ffmpeg") && error.contains(".gif, .png or .apng"), "{error}");
}

#[test]
fn ffmpeg_reads_every_frame_and_reports_errors() {
    let dir = tempfile::tempdir().unwrap();
    let (program, path) = (dir.path().join("ffmpeg"), dir.path().join("x.mp4"));
    let encode = |script: &str| {
        std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(&program, std::os::unix::fs::PermissionsExt::from_mode(0o700)).unwrap();
        let mut movie = Mp4::begin(&program, &path, 3, &frames()[0])?;
        frames()[1..].iter().try_for_each(|frame| movie.push(frame))?;
        movie.finish()
    };
    encode("echo \"$@\" > \"$0.args\"; for file; do :; done; cat > \"${file#file:}\"").unwrap();
    let raw: Vec<u8> = frames().iter().flat_map(RgbImage::pixels).flatten().collect();
    assert_eq!(std::fs::read(&path).unwrap(), raw);
    let args = std::fs::read_to_string(dir.path().join("ffmpeg.args")).unwrap();
    assert!(args.contains("-s 40x40 -r 20/3 -i -") && args.contains("yuv420p"), "{args}");
    let error = encode("echo Unknown encoder >&2; exit 1").unwrap_err();
    assert_eq!(error.to_string(), "ffmpeg failed: Unknown encoder");
}

#[test]
fn unfinished_movie_leaves_no_file() {
    let dir = tempfile::tempdir().unwrap();
    for format in [MovieFormat::Apng, MovieFormat::Gif] {
        let movie = MovieWriter::begin(&dir.path().join("x"), format, 3, 1, frames().remove(0)).unwrap();
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        drop(movie);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    }
}

#[test]
fn format_follows_from_extension() {
    assert_eq!(MovieFormat::from_path(Path::new("a/b.GIF")), Ok(MovieFormat::Gif));
    assert_eq!(MovieFormat::from_path(Path::new("b.apng")), Ok(MovieFormat::Apng));
    assert_eq!(MovieFormat::from_path(Path::new("b.mp4")), Ok(MovieFormat::Mp4));
    for unknown in ["a/b.avi", "gif", "a.gif.part"] {
        let error = MovieFormat::from_path(Path::new(unknown)).unwrap_err();
        assert_eq!(error.to_string(), format!("{unknown}: a movie's name ends in .png, .apng, .gif, .mp4"));
    }
}
