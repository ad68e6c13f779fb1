//! Vehicles on the carriageway: moving in the lanes and parked along the kerbs.

use std::f32::consts::PI;

use rand::RngExt;

use super::mesh::{Builder, Place};
use super::site::{REACH, Site, near_branch};
use super::{FREE_RADIUS_M, cycles, vehicles};

/// Cars, and lorries and buses, keep this far from the rig: one beside it would fill the picture.
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
        [(cycles::ridden_bicycle as fn(&mut Builder, &Place), 4), (cycles::ridden_motorcycle, 3)]
    {
        for _ in 0..count {
            two_wheeler(site, make);
        }
    }
}

/// Cars parked along the kerb of one side, if that is allowed there.
pub fn parked(site: &mut Site, side: usize) {
    if !site.street.parking[side] {
        return;
    }
    let (sign, traffic_yaw) = if side == 1 { (1.0, PI) } else { (-1.0, 0.0) };
    let d = sign * (site.street.kerb_at(side) - 1.1);
    let mut s = -REACH;
    while s < REACH {
        let yaw = traffic_yaw + site.builder.rng.random_range(-0.05..0.05);
        if !near_branch(&site.street, side, s, 4.0) && site.builder.rng.random_bool(0.6) {
            let kind = site.builder.rng.random_range(2..10);
            vehicle(site, kind, s, d, yaw);
        }
        s += site.builder.rng.random_range(5.8..8.0);
    }
}

/// A vehicle of a kind, if there is room for it.
fn vehicle(site: &mut Site, kind: usize, s: f32, d: f32, yaw: f32) {
    let (make, half_size, gap): (fn(&mut Builder, &Place), _, _) = match kind {
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
fn two_wheeler(site: &mut Site, make: fn(&mut Builder, &Place)) {
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
