//! Layout of a scene: one street with all its objects, and the rig in one of its lanes.

use std::f32::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::mesh::{MeshBuilder, Place};
use crate::scene::Scene;
use crate::sensors::RigMotion;
use crate::street::{REACH, Site, Street, is_near_branch};
use crate::surface::Light;
use crate::{FREE_RADIUS_M, furniture, ground_mesh, parcels, people, vegetation, vehicles};

/// Mounting height of the LiDAR above the road.
const MOUNT_M: std::ops::Range<f64> = 1.7..1.9;
/// Largest angle between the heading of the rig and its lane, and largest inclination.
const MAX_HEADING_OFF: f64 = 25.0;
/// A moving rig keeps to its lane: a path across the street would lead into houses and fences.
const MAX_MOVING_HEADING_OFF: f64 = 10.0;
const MAX_INCLINATION_DEG: f64 = 2.0;
/// Radius of a crown relative to the height of the tree. The rig never stands under one.
const CROWN_REACH: f32 = 0.7;
/// The kerb is more crowded up to this distance.
const NEAR: f32 = 16.0;

/// A scene with a rig in it.
pub struct Capture {
    pub scene: Scene,
    pub light: Light,
    /// The pose of the rig, which is that of its first LiDAR, at the middle of the sweep.
    t_world_rig: Isometry3<f64>,
    pub motion: RigMotion,
}

impl Capture {
    /// A scene, and a rig that passes through it from a pose at the middle of the sweep.
    pub fn new(scene: Scene, light: Light, t_world_rig: Isometry3<f64>, motion: RigMotion) -> Self {
        Self { scene, light, t_world_rig, motion }
    }

    /// The rig's pose at a time, seconds from the middle of the sweep.
    pub fn t_world_rig(&self, time_s: f64) -> Isometry3<f64> {
        self.motion.pose_at(&self.t_world_rig, time_s)
    }
}

pub fn build(mut rng: ChaCha8Rng, tilt_deg: f64, motion: RigMotion) -> Capture {
    let street = Street::random(&mut rng);
    let light = Light::random(&mut rng);
    let lane = rng.random_range(0..street.lanes);
    let rig_d = street.lane_center(lane) + rng.random_range(-0.4..0.4);
    let t_world_rig = rig_pose(&mut rng, &street, lane, rig_d, tilt_deg, motion.is_moving());
    let path = motion.positions(street.at(0.0, rig_d), &t_world_rig);
    let mut site = Site::new(MeshBuilder::new(rng, path.clone()), street, path);
    ground_mesh::build(&mut site.builder, &site.street);
    moving(&mut site);
    for side in [0, 1] {
        parked(&mut site, side);
        kerbside(&mut site, side);
        pavement(&mut site, side);
        parcels::build(&mut site, side);
    }
    parcels::backdrop(&mut site);
    Capture::new(Scene::new(site.builder), light, t_world_rig, motion)
}

fn rig_pose(
    rng: &mut ChaCha8Rng,
    street: &Street,
    lane: usize,
    d: f32,
    tilt_deg: f64,
    is_moving: bool,
) -> Isometry3<f64> {
    let spot = street.rig_spot(d);
    let height = f64::from(spot.z) + rng.random_range(MOUNT_M);
    let along = if street.lane_runs_ahead(lane) { 0.0 } else { 180.0 };
    let quarter_turns = [0, 0, 0, 0, 0, 1, 2, 3][rng.random_range(0..8)];
    let off = rng.random_range(-MAX_HEADING_OFF..MAX_HEADING_OFF);
    let (quarter_turns, off) =
        if is_moving { (0, off * (MAX_MOVING_HEADING_OFF / MAX_HEADING_OFF)) } else { (quarter_turns, off) };
    let yaw: f64 = along + 90.0 * f64::from(quarter_turns) + off;
    let mut incline = || rng.random_range(-MAX_INCLINATION_DEG..MAX_INCLINATION_DEG).to_radians();
    let (roll, pitch) = (incline(), incline() + tilt_deg.to_radians());
    Isometry3::from_parts(
        Translation3::new(f64::from(spot.x), f64::from(spot.y), height),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw.to_radians()),
    )
}

/// Posts, trees and furniture along the kerb.
fn kerbside(site: &mut Site, side: usize) {
    let sign = if side == 1 { 1.0 } else { -1.0 };
    let kerb = site.street.kerb_at(side);
    let traffic_yaw = if side == 0 { 0.0 } else { PI };
    let d = sign * (kerb + 0.5);
    let lamp_pitch = site.builder.rng.random_range(18.0..28.0);
    let mut s = -REACH + site.builder.rng.random_range(0.0..lamp_pitch);
    while s < REACH {
        let reach = -sign * 1.6;
        place_at(site, side, s, d, 0.0, 0.3, |b, place| furniture::lamp_post(b, place, reach));
        s += lamp_pitch;
    }
    signals(site, side, d, traffic_yaw);
    let mut s = -REACH + site.builder.rng.random_range(0.0..4.0);
    while s < REACH {
        kerb_object(site, side, s, d, traffic_yaw);
        let near = s.abs() < NEAR;
        s += site.builder.rng.random_range(if near { 1.6..3.2 } else { 3.0..7.0 });
    }
}

/// Traffic lights at the side street, or else at a crossing, and signs.
fn signals(site: &mut Site, side: usize, d: f32, yaw: f32) {
    let at = site.street.side_street.map_or(if side == 0 { 16.0 } else { -14.0 }, |branch| branch.s);
    let ahead = if side == 0 { -1.0 } else { 1.0 };
    let reach = if site.builder.rng.random_bool(0.5) { 3.2 } else { 0.0 };
    for (offset, turn) in [(6.5, 0.0), (-6.5, PI)] {
        let s = at + ahead * offset;
        place_at(site, side, s, d, yaw + turn, 0.3, |b, place| {
            furniture::traffic_light(b, place, reach * turn.cos())
        });
    }
    for _ in 0..7 {
        let s = site.builder.rng.random_range(-45.0..45.0);
        let turn = [0.0, 0.0, PI, FRAC_PI_2][site.builder.rng.random_range(0..4)];
        place_at(site, side, s, d, yaw + turn, 0.3, furniture::traffic_sign);
    }
    let s = site.builder.rng.random_range(-30.0..30.0);
    place_at(site, side, s, d * 1.06, yaw, 1.2, furniture::direction_panel);
}

fn kerb_object(site: &mut Site, side: usize, s: f32, d: f32, traffic_yaw: f32) {
    let toward_street = if side == 1 { PI } else { 0.0 };
    match site.builder.rng.random_range(0..12) {
        0..=2 => {
            let height = site.builder.rng.random_range(5.0..9.5);
            if site.builder.distance(&site.street.place(s, d, 0.0)) < CROWN_REACH * height {
                return;
            }
            place_at(site, side, s, d, 0.0, 0.5, |b, place| vegetation::tree(b, place, height));
        }
        3 | 4 => place_at(site, side, s, d, toward_street, 0.5, furniture::small_object),
        5 => place_at(site, side, s, d, 0.0, 0.8, furniture::wheeled_bins),
        6 => place_at(site, side, s, d, 0.0, 0.8, |b, place| {
            furniture::bollards(b, &place.shifted(-0.8, 0.0, 0.0, 0.0), 2)
        }),
        7 => place_at(site, side, s, d, traffic_yaw, 1.0, people::bicycle),
        8 => place_at(site, side, s, d, traffic_yaw + 0.5, 1.0, people::motorcycle),
        9 => place_at(site, side, s, d, toward_street, 1.0, furniture::bench),
        10 => place_at(site, side, s, d, 0.0, 0.4, furniture::mast),
        _ => place_at(site, side, s, d, 0.0, 1.2, |b, place| {
            furniture::railing(b, &place.shifted(-1.5, 0.0, 0.0, 0.0), 3.0);
        }),
    }
}

/// People and shelters on the sidewalk, and people crossing.
fn pavement(site: &mut Site, side: usize) {
    let sign = if side == 1 { 1.0 } else { -1.0 };
    let start = site.street.kerb_at(side) + site.street.verge;
    let end = site.street.frontage_at(side);
    let toward_street = if side == 1 { PI } else { 0.0 };
    for _ in 0..2 {
        let s = site.builder.rng.random_range(-40.0..40.0);
        place_at(site, side, s, sign * (end - 0.6), toward_street, 1.6, furniture::shelter);
    }
    for i in 0..20 {
        let far = if i < 10 { NEAR } else { 50.0 };
        let s = site.builder.rng.random_range(-far..far);
        let d = sign * site.builder.rng.random_range(start + 0.3..end - 0.2);
        let yaw = site.builder.rng.random_range(-PI..PI);
        place_at(site, side, s, d, yaw, 0.35, people::pedestrian);
    }
    for _ in 0..3 {
        let s = site.builder.rng.random_range(-30.0..30.0);
        let d = sign * site.builder.rng.random_range(0.5..start);
        if site.claim(s, d, 0.4) {
            people::pedestrian(&mut site.builder, &site.street.place(s, d, sign * FRAC_PI_2));
        }
    }
}

/// Puts an object on a disc of ground if the disc is free and off the carriageway of the side street.
fn place_at(
    site: &mut Site,
    side: usize,
    s: f32,
    d: f32,
    yaw: f32,
    radius: f32,
    make: impl FnOnce(&mut MeshBuilder, &Place),
) {
    if !is_near_branch(&site.street, side, s, radius) && site.claim(s, d, radius) {
        make(&mut site.builder, &site.street.place(s, d, yaw));
    }
}

/// Smallest distance from the rig of cars, and of lorries and buses: one next to the rig would fill the image.
const CAR_GAP: f32 = 3.6;
const BIG_VEHICLE_GAP: f32 = 9.0;

/// Moving vehicles and two-wheelers in the lanes.
pub fn moving(site: &mut Site) {
    for lane in 0..site.street.lanes {
        let d = site.street.lane_center(lane);
        let yaw = if site.street.lane_runs_ahead(lane) { 0.0 } else { PI };
        let mut s = -REACH + site.builder.rng.random_range(0.0..8.0);
        while s < REACH {
            let kind = site.builder.rng.random_range(0..10);
            vehicle(site, kind, s, d, yaw);
            s += site.builder.rng.random_range(8.0..19.0);
        }
    }
    for (make, count) in
        [(people::ridden_bicycle as fn(&mut MeshBuilder, &Place), 4), (people::ridden_motorcycle, 3)]
    {
        for _ in 0..count {
            two_wheeler(site, make);
        }
    }
}

/// Cars parked along the kerb of one side, if parking is allowed there.
pub fn parked(site: &mut Site, side: usize) {
    if !site.street.parking[side] {
        return;
    }
    let (sign, traffic_yaw) = if side == 1 { (1.0, PI) } else { (-1.0, 0.0) };
    let d = sign * (site.street.kerb_at(side) - 1.1);
    let mut s = -REACH;
    while s < REACH {
        let yaw = traffic_yaw + site.builder.rng.random_range(-0.05..0.05);
        if !is_near_branch(&site.street, side, s, 4.0) && site.builder.rng.random_bool(0.6) {
            let kind = site.builder.rng.random_range(2..10);
            vehicle(site, kind, s, d, yaw);
        }
        s += site.builder.rng.random_range(5.8..8.0);
    }
}

/// A vehicle of the given kind, if there is room for it.
fn vehicle(site: &mut Site, kind: usize, s: f32, d: f32, yaw: f32) {
    let (make, half_size, gap): (fn(&mut MeshBuilder, &Place), _, _) = match kind {
        0 => (vehicles::truck, [5.0, 1.25], BIG_VEHICLE_GAP),
        1 => (vehicles::bus, [6.2, 1.3], BIG_VEHICLE_GAP),
        2 => (vehicles::van, [3.0, 1.1], BIG_VEHICLE_GAP),
        _ => (vehicles::car, [2.8, 1.0], CAR_GAP),
    };
    if site.claim_long(s, d, yaw, half_size, gap) {
        make(&mut site.builder, &site.street.place(s, d, yaw));
    }
}

/// A ridden two-wheeler somewhere in the lanes, nearer to the rig than the cars.
fn two_wheeler(site: &mut Site, make: fn(&mut MeshBuilder, &Place)) {
    for _ in 0..12 {
        let lane = site.builder.rng.random_range(0..site.street.lanes);
        let yaw = if site.street.lane_runs_ahead(lane) { 0.0 } else { PI };
        let d = site.street.lane_center(lane) + site.builder.rng.random_range(-1.3..1.3);
        let s = site.builder.rng.random_range(-25.0..25.0);
        if site.claim_long(s, d, yaw, [1.1, 0.4], FREE_RADIUS_M) {
            let turned = yaw + site.builder.rng.random_range(-0.3..0.3);
            make(&mut site.builder, &site.street.place(s, d, turned));
            return;
        }
    }
}
