//! A small scene for tests.

use std::sync::Arc;

use geometry::camera::Camera;

use crate::label_image::LabelImage;
use crate::observation::Partitions;
use crate::observation::{Frame, Observations};

const WIDTH: usize = 64;
const HEIGHT: usize = 48;

/// A label image of blobs, and points in front of it with the classes of their pixels at the identity.
pub(super) fn scene(shift: f64) -> Arc<Observations> {
    let k = [[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]];
    let camera =
        Camera::new("plumb_bob", (WIDTH, HEIGHT), k, &[0.05, -0.01, 0.001, 0.002]).expect("a valid camera");
    let class = |u: f64, v: f64| {
        u8::from((u / 9.0 + shift).sin() + (v / 7.0).cos() > 0.2) + u8::from((u * v / 300.0).sin() > 0.6)
    };
    let pixels = (0..HEIGHT).flat_map(|v| (0..WIDTH).map(move |u| (u as f64, v as f64)));
    let ids = pixels.map(|(u, v)| class(u, v)).collect();
    let (mut points, mut point_classes) = (Vec::new(), Vec::new());
    for i in 0..900 {
        let pixel = nalgebra::Point2::new(f64::from(i % 30) * 2.1 + 0.3, f64::from(i / 30) * 1.55 + 0.4);
        if let Some(ray) = camera.unproject(&pixel) {
            let point = ray * (4.0 + f64::from(i % 7));
            points.push([point.x as f32, point.y as f32, point.z as f32]);
            point_classes.push(class(pixel.x, pixel.y));
        }
    }
    let image_classes = LabelImage { width: WIDTH, height: HEIGHT, ids };
    let frame = Frame::certain(points, point_classes, image_classes);
    Arc::new(Observations::new(camera, vec![frame], 3, 3).expect("valid observations"))
}

/// Frames of the scene in which each blob is a segment, with two null partitions elsewhere.
pub(super) fn segmented(num_frames: usize) -> Arc<Observations> {
    let frame = |index: usize| {
        let mut frame = scene(0.3 * index as f64).frames[0].clone();
        let count = frame.points.len();
        let ids = |shift: usize| (0..count).map(move |i| (i + shift) % count);
        let segment = |i: usize| u32::from(frame.point_classes[i]) + 3 * u32::from(i % 30 > 14);
        let mixed = ids(0).zip(ids(count / 3)).zip(ids(2 * count / 3));
        let ids: Vec<u32> = mixed.flat_map(|((a, b), c)| [segment(a), segment(b), segment(c)]).collect();
        frame.partitions = Some(Arc::new(Partitions::new(&ids, 6, 3).expect("ids of each point")));
        frame
    };
    let camera = scene(0.0).camera.clone();
    Arc::new(
        Observations::new(camera, (0..num_frames).map(frame).collect(), 3, 3).expect("valid observations"),
    )
}
