//! The ground as triangles: a grid in street coordinates whose lines follow every border between classes.

use crate::carla_classes::Class;
use crate::mesh::{MeshBuilder, Paint};
use crate::street::{LINE_WIDTH, Street};

/// Extent of the ground along the street, and to its sides.
const HALF_LENGTH: f32 = 108.0;
const HALF_WIDTH: f32 = 84.0;
/// Rows as (distance up to which they apply, length). Every length divides [`crate::street::DASH`].
const ROWS: [(f32, f32); 3] = [(24.0, 0.75), (48.0, 1.5), (HALF_LENGTH, 3.0)];
const MAX_PAVED_COLUMN: f32 = 1.2;
/// Growth factor of the width of terrain columns, up to a limit.
const COLUMN_GROWTH: f32 = 1.25;
const MAX_COLUMN: f32 = 8.0;
/// Grid lines nearer than this are merged.
const MERGE: f32 = 0.01;

struct Paints {
    road: Paint,
    line: Paint,
    sidewalk: Paint,
    terrain: Paint,
    kerb: Paint,
}

impl Paints {
    fn of(&self, class: Class) -> Paint {
        match class {
            Class::Road => self.road,
            Class::RoadLine => self.line,
            Class::Sidewalk => self.sidewalk,
            _ => self.terrain,
        }
    }
}

pub fn build(builder: &mut MeshBuilder, street: &Street) {
    let paints = Paints {
        road: builder.paint(Class::Road),
        line: builder.paint(Class::RoadLine),
        sidewalk: builder.paint(Class::Sidewalk),
        terrain: builder.paint(Class::Terrain),
        kerb: builder.paint(Class::Sidewalk),
    };
    let (rows, columns) = (rows(street), columns(street));
    let middle = |pair: &[f32]| 0.5 * (pair[0] + pair[1]);
    let class = |row: &[f32], column: &[f32]| street.class_at(middle(row), middle(column));
    for row in rows.windows(2) {
        for column in columns.windows(2) {
            let class = class(row, column);
            let step = street.step(class);
            let corner = |s, d| street.at(s, d).extend(street.relief(s, d) + step);
            let [s0, s1, d0, d1] = [row[0], row[1], column[0], column[1]];
            builder.quad(paints.of(class), [corner(s0, d0), corner(s1, d0), corner(s1, d1), corner(s0, d1)]);
        }
    }
    let mut kerb = |from: (f32, f32), to: (f32, f32), classes: [Class; 2]| {
        let steps = classes.map(|class| street.step(class));
        if steps[0] == steps[1] {
            return;
        }
        let foot = |(s, d)| street.at(s, d).extend(street.relief(s, d));
        let raise = |(s, d)| foot((s, d)) + parry3d::math::Vec3::Z * street.kerb;
        builder.quad(paints.kerb, [foot(from), foot(to), raise(to), raise(from)]);
    };
    for row in rows.windows(2) {
        for d in columns.windows(3) {
            let sides = [class(row, &d[..2]), class(row, &d[1..])];
            kerb((row[0], d[1]), (row[1], d[1]), sides);
        }
    }
    for column in columns.windows(2) {
        for s in rows.windows(3) {
            let sides = [class(&s[..2], column), class(&s[1..], column)];
            kerb((s[1], column[0]), (s[1], column[1]), sides);
        }
    }
}

/// Grid lines across the street.
fn rows(street: &Street) -> Vec<f32> {
    let mut lines = vec![0.0];
    let mut s = 0.0;
    for (limit, length) in ROWS {
        while s < limit {
            s += length;
            lines.extend([s, -s]);
        }
    }
    if let Some(branch) = &street.side_street {
        for offset in [branch.half_width, branch.half_width + branch.sidewalk, 0.5 * LINE_WIDTH] {
            lines.extend([branch.s - offset, branch.s + offset]);
        }
    }
    sorted(lines)
}

/// Grid lines along the street.
fn columns(street: &Street) -> Vec<f32> {
    let mut lines = Vec::new();
    for (line, _) in street.lines() {
        lines.extend([line - 0.5 * LINE_WIDTH, line + 0.5 * LINE_WIDTH]);
    }
    for (side, sign) in [(0, -1.0), (1, 1.0)] {
        let kerb = street.kerb_at(side);
        lines.extend([sign * kerb, sign * (kerb + street.verge), sign * street.frontage_at(side)]);
        let mut width = MAX_PAVED_COLUMN;
        let mut d = street.frontage_at(side);
        while d < HALF_WIDTH {
            d += width;
            width = (width * COLUMN_GROWTH).min(MAX_COLUMN);
            lines.push(sign * d);
        }
    }
    let lines = sorted(lines);
    let paved = street.frontage_at(0).max(street.frontage_at(1));
    let gaps = lines.windows(2).filter(|gap| gap[0] > -paved - MERGE && gap[1] < paved + MERGE);
    let between = gaps.flat_map(|gap| {
        let parts = ((gap[1] - gap[0]) / MAX_PAVED_COLUMN).ceil();
        (1..parts as usize).map(move |i| gap[0] + (gap[1] - gap[0]) * i as f32 / parts)
    });
    sorted(between.chain(lines.iter().copied()).collect())
}

fn sorted(mut lines: Vec<f32>) -> Vec<f32> {
    lines.sort_by(f32::total_cmp);
    lines.dedup_by(|a, b| (*a - *b).abs() < MERGE);
    lines
}
