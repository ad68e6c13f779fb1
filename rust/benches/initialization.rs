//! Times of the stages of the initial calibration: `cargo bench`. 1280 x 720 pictures and 64 x 1024 sweeps.

use std::hint::black_box;

use std::sync::Arc;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use semcal::agreement;
use semcal::alignment::{self, AlignmentConfig, Counted, PolishConfig};
use semcal::camera::Camera;
use semcal::classes::NO_CLASS;
use semcal::correspondences;
use semcal::label_image::LabelImage;
use semcal::observation::{Frame, Observations};
use semcal::registration::{self, RegistrationConfig};
use semcal::spherical::{SphericalGrid, SphericalImages};
use semcal::world::{Lidar, Renderer, Rig, ScanPattern, Shutter, UNLABELED};
use semcal::zoom::{Placement, Zoom, Zoomed};

const SIZE: (usize, usize) = (1280, 720);
const CHANNELS: usize = 64;
const COLUMNS: usize = 1024;
const FOV_DEG: (f64, f64) = (10.0, -30.0);
const NUM_CLASSES: usize = 32;
const NUM_FRAMES: [usize; 3] = [5, 10, 20];
const SEED: u64 = 0;

fn camera() -> Camera {
    let k = [[640.0, 0.0, 639.5], [0.0, 640.0, 359.5], [0.0, 0.0, 1.0]];
    Camera::new("plumb_bob", SIZE, k, &[]).expect("a valid camera")
}

fn pose() -> Isometry3<f64> {
    let axes = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Isometry3::from_parts(Translation3::new(0.2, -0.5, -0.3), rotation)
}

fn frames(count: usize) -> Vec<Frame> {
    let pattern = ScanPattern::Spinning {
        channels: CHANNELS,
        columns: COLUMNS,
        fov_up_deg: FOV_DEG.0,
        fov_down_deg: FOV_DEG.1,
    };
    let lidar = Lidar { pattern, ..Lidar::default() };
    let rig = Rig { lidar, camera: camera(), t_camera_lidar: pose(), shutter: Shutter::default() };
    let renderer = Renderer::new(rig).expect("a valid rig");
    let class = |id: u8| if id == UNLABELED { NO_CLASS } else { id };
    let frame = |number| {
        let frame = renderer.frame(SEED, number);
        let points = frame.points.iter().map(|&[x, y, z, _]| [x, y, z]).collect();
        let point_classes = frame.point_labels.iter().map(|&label| class(label as u8)).collect();
        let ids = frame.image_labels.iter().map(|&id| class(id)).collect();
        Frame::certain(points, point_classes, LabelImage { width: SIZE.0, height: SIZE.1, ids })
    };
    (0..count as u64).map(frame).collect()
}

fn grid() -> SphericalGrid {
    let (up, down) = (FOV_DEG.0.to_radians(), FOV_DEG.1.to_radians());
    SphericalGrid::from_scan(CHANNELS, COLUMNS, up, down).expect("a valid scan")
}

fn registration_config() -> RegistrationConfig {
    RegistrationConfig {
        zoom: Zoom::Exact,
        coarse_cell: 3f64.to_radians(),
        fine_cell: 1.5f64.to_radians(),
        max_roll: 15f64.to_radians(),
        roll_step: 5f64.to_radians(),
        min_cells_of_most: 0.1,
        num_hypotheses: 24,
        separation: 15f64.to_radians(),
    }
}

/// Levels and hypotheses of each, as the pipeline has them.
const LEVELS: [(usize, usize); 4] = [(8, 24), (16, 12), (8, 8), (4, 6)];

const ALIGNMENT: AlignmentConfig = AlignmentConfig {
    edge_band_px: 0,
    steps: 60,
    batch_size: 2048,
    step_size: 0.2,
    final_step: 0.05,
    max_baseline_m: 3.0,
    max_points: 100_000,
};

const POLISH: PolishConfig =
    PolishConfig { edge_band_px: 0, max_rounds: 8, max_steps: 8, tolerance_px: 0.01, max_baseline_m: 3.0 };

fn one_frame(c: &mut Criterion) {
    let frame = frames(1).remove(0);
    let mut group = c.benchmark_group("one frame");
    group.throughput(Throughput::Elements(frame.points.len() as u64));
    group.bench_function("spherical projection", |b| b.iter(|| grid().project(black_box(&frame.points))));
    group.finish();
    let camera = camera();
    let zoomed = Zoomed::new(&camera, Zoom::Exact).expect("a picture");
    let level = Placement { azimuth: 0.0, elevation: 0.0, roll: 0.0, scale: 1.0 };
    c.bench_function("one frame/majority of blocks of 8 pixels", |b| {
        b.iter(|| registration::majority(black_box(&frame.image.classes), 8));
    });
    c.bench_function("one frame/resampling of the label image onto the grid", |b| {
        b.iter(|| {
            let pixel_of = zoomed.pixel_map(black_box(&level));
            let cells = (0..CHANNELS).flat_map(|row| (0..COLUMNS).map(move |column| (row, column)));
            let directions = cells.map(|(row, column)| grid().direction(row, column));
            let classes = directions
                .filter_map(|direction| pixel_of(&direction))
                .map(|pixel| frame.image.classes.at((pixel.x + 0.5) as usize, (pixel.y + 0.5) as usize));
            classes.map(u64::from).sum::<u64>()
        });
    });
}

fn over_frames(c: &mut Criterion) {
    let all = frames(NUM_FRAMES[2]);
    let mut group = c.benchmark_group("frames");
    group.sample_size(10);
    for count in NUM_FRAMES {
        let frames = all[..count].to_vec();
        let observations = Observations::new(camera(), frames, NUM_CLASSES, NUM_CLASSES)
            .map(Arc::new)
            .expect("valid frames");
        let config = registration_config();
        let images = SphericalImages::new(&observations, grid());
        let hypotheses = registration::register(&observations, &images, &config, None).expect("an overlap");
        group.bench_function(BenchmarkId::new("spherical images", count), |b| {
            b.iter(|| SphericalImages::new(&observations, grid()));
        });
        group.bench_function(BenchmarkId::new("registration", count), |b| {
            b.iter(|| registration::register(&observations, &images, &config, None));
        });
        group.bench_function(BenchmarkId::new("correspondences", count), |b| {
            b.iter(|| correspondences::sample(&observations, &images, Zoom::Exact, &hypotheses, 2000, SEED));
        });
        group.bench_function(BenchmarkId::new("alignment, all levels", count), |b| {
            b.iter(|| {
                LEVELS.map(|(factor, num_starts)| {
                    alignment::align(
                        &observations,
                        &vec![pose(); num_starts],
                        factor,
                        Counted::All,
                        &ALIGNMENT,
                        SEED,
                    )
                })
            });
        });
        group.bench_function(BenchmarkId::new("polish", count), |b| {
            b.iter(|| alignment::polish(&observations, &pose(), None, Counted::Visible, &POLISH));
        });
        group.bench_function(BenchmarkId::new("agreement of one pose", count), |b| {
            b.iter(|| agreement::measure(&observations, &pose()));
        });
    }
    group.finish();
}

fn over_cells(c: &mut Criterion) {
    let observations =
        Observations::new(camera(), frames(NUM_FRAMES[0]), NUM_CLASSES, NUM_CLASSES).expect("valid frames");
    let images = SphericalImages::new(&observations, grid());
    let mut group = c.benchmark_group("registration, cells of the sphere");
    group.sample_size(10);
    for cell_deg in [4.0f64, 3.0, 2.0] {
        let coarse_cell = cell_deg.to_radians();
        let cells = grid().coarsened(coarse_cell);
        let config = RegistrationConfig { coarse_cell, ..registration_config() };
        group.bench_function(BenchmarkId::from_parameter(cells.rows * cells.columns), |b| {
            b.iter(|| registration::register(&observations, &images, &config, None));
        });
    }
    group.finish();
}

criterion_group!(benches, one_frame, over_frames, over_cells);
criterion_main!(benches);
