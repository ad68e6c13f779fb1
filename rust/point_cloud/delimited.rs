//! Clouds as lines of numbers: `.csv`, and Leica's `.pts` and `.ptx`.
//!
//! A `.csv` has a line of names, which may be a comment, or the columns x y z, and intensity; its separator is a comma, a
//! semicolon, a tab or blanks. A `.pts` starts with the number of points. A `.ptx` starts with the columns and rows of a
//! scan, and the pose of the scanner in eight lines, which is not used: its points are in the frame of the scanner, and
//! zero where nothing returned. Source: Leica's descriptions of both, *Cyclone pointcloud export format*.

use super::ascii::{self, Token};
use super::fields::{find, find_own};
use super::limit::{ParseResult, quoted};
use super::options::Reading;
use super::table::Table;

/// Lines of the pose of a scanner: its position, three axes, and a 4 x 4 matrix.
const POSE_LINES: usize = 8;
/// Names of VeloView's columns in place of x, y and z, up to their last character.
const VELOVIEW: [&str; 2] = ["points_m_xyz:", "points:"];
/// Columns of a table of Ouster's SDK (`ouster-cli source FILE save TABLE.csv`), of which the first tells it, and what
/// they mean. Its times are in nanoseconds.
const OUSTER: [(&str, &str); 7] = [
    ("x1 (m)", "x"),
    ("y1 (m)", "y"),
    ("z1 (m)", "z"),
    ("signal (photons)", "intensity"),
    ("reflectivity (%)", "reflectivity"),
    ("row", "ring"),
    ("timestamp (ns)", "t"),
];

pub(super) fn parse_csv(bytes: &[u8], reading: &Reading) -> ParseResult<Table<'static>> {
    let (remarks, lines) = split_remarks(bytes);
    let (first, rest) = split_line(lines);
    let separator = [b',', b';', b'\t'].into_iter().find(|separator| first.contains(separator));
    let found = cells(first, separator);
    let (names, lines) = if found.iter().all(|cell| is_number(cell)) {
        // The last comment that names the columns, or the usual ones.
        let mut remarks = remarks.iter().rev().map(|line| names(line, separator));
        let named = remarks.find(|names| names.len() == found.len() && meanings(names).contains(&"x"));
        let usual = || usual_names(found.len(), &[&["x", "y", "z"], &["x", "y", "z", "intensity"]]);
        (named.map_or_else(usual, Ok)?, lines)
    } else {
        (names(first, separator), rest)
    };
    match separator {
        Some(separator) => {
            let blank = |&byte: &u8| if byte == separator { b' ' } else { byte };
            let lines: Vec<u8> = lines.iter().map(blank).collect();
            table(&lines, &names, count_lines(&lines), reading)
        }
        None => table(lines, &names, count_lines(lines), reading),
    }
}

pub(super) fn parse_pts(bytes: &[u8], reading: &Reading) -> ParseResult<Table<'static>> {
    let (first, lines) = split_line(bytes);
    let promised = whole_number(first).ok_or("is not a PTS file: its first line is no number of points")?;
    leica(lines, promised, reading)
}

pub(super) fn parse_ptx(bytes: &[u8], reading: &Reading) -> ParseResult<Table<'static>> {
    let (columns, rest) = split_line(bytes);
    let (rows, mut lines) = split_line(rest);
    let area =
        whole_number(columns).zip(whole_number(rows)).and_then(|(columns, rows)| columns.checked_mul(rows));
    let promised = area.ok_or("is not a PTX file: its first lines are no numbers of columns and rows")?;
    for _ in 0..POSE_LINES {
        lines = split_line(lines).1;
    }
    leica(lines, promised, reading)
}

fn leica(lines: &[u8], promised: usize, reading: &Reading) -> ParseResult<Table<'static>> {
    const USUAL: [&[&str]; 4] = [
        &["x", "y", "z"],
        &["x", "y", "z", "intensity"],
        &["x", "y", "z", "r", "g", "b"],
        &["x", "y", "z", "intensity", "r", "g", "b"],
    ];
    let found = count_lines(lines);
    if found != promised {
        return Err(format!("holds {found} lines of points, its header promises {promised} of one scan"));
    }
    let names = usual_names(cells(split_line(lines).0, None).len(), &USUAL)?;
    table(lines, &names, found, reading)
}

fn table(
    lines: &[u8],
    names: &[String],
    num_points: usize,
    reading: &Reading,
) -> ParseResult<Table<'static>> {
    reading.limit.check_points(num_points)?;
    let meanings = meanings(names);
    let mut fields = find(&meanings, None)?;
    if let Some(own) = &reading.own_points {
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        fields.own = Some(find_own(&meanings, own).or_else(|_| find_own(&names, own))?);
    }
    // Text does not tell the type of a number: all are floats, and times seconds where their name does not say more.
    let is_ns = fields.time.is_some_and(|time| names[time] != meanings[time]);
    let seconds_per_tick = if is_ns { 1e-9 } else { 1.0 };
    ascii::parse(lines, num_points, vec![Token::Skipped(1); names.len()], fields, seconds_per_tick)
}

/// The names of columns, where those of Ouster's SDK have usual ones.
fn meanings(names: &[String]) -> Vec<&str> {
    let [(of_ouster, _), ..] = OUSTER;
    let is_of_ouster = names.iter().any(|name| name == of_ouster);
    let meaning = |name: &String| OUSTER.iter().find(|(found, _)| is_of_ouster && name == found);
    names.iter().map(|name| meaning(name).map_or(name.as_str(), |(_, meant)| meant)).collect()
}

/// The names of columns without names, by their number.
fn usual_names(count: usize, usual: &[&[&str]]) -> ParseResult<Vec<String>> {
    let names = usual.iter().find(|names| names.len() == count);
    let names = names.ok_or_else(|| {
        let usual: Vec<String> = usual.iter().map(|names| names.join(" ")).collect();
        format!(
            "has {count} columns without names, needs {}, or a .csv with a line of names",
            usual.join(" or ")
        )
    })?;
    Ok(names.iter().map(|&name| name.to_owned()).collect())
}

/// The comments in front, and what follows them.
fn split_remarks(mut bytes: &[u8]) -> (Vec<&[u8]>, &[u8]) {
    let mut remarks = Vec::new();
    loop {
        let (first, rest) = split_line(bytes);
        if !first.starts_with(b"#") {
            return (remarks, bytes);
        }
        remarks.push(first);
        bytes = rest;
    }
}

/// The first line that is not blank, and what follows it.
fn split_line(bytes: &[u8]) -> (&[u8], &[u8]) {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    let end = bytes.iter().position(|&byte| byte == b'\n').unwrap_or(bytes.len());
    let (line, rest) = bytes.split_at(end);
    (line.trim_ascii_end(), rest)
}

fn cells(line: &[u8], separator: Option<u8>) -> Vec<&[u8]> {
    let Some(separator) = separator else {
        return line.split(u8::is_ascii_whitespace).filter(|cell| !cell.is_empty()).collect();
    };
    let mut cells: Vec<&[u8]> = line.split(|&byte| byte == separator).map(<[u8]>::trim_ascii).collect();
    // Some writers end each line with a separator.
    let _ = cells.pop_if(|last| last.is_empty());
    cells
}

fn names(line: &[u8], separator: Option<u8>) -> Vec<String> {
    let start = line.iter().position(|byte| !b"#/ ".contains(byte)).unwrap_or(line.len());
    let line = &line[start..];
    cells(line, separator).into_iter().map(name).collect()
}

fn is_number(cell: &[u8]) -> bool {
    std::str::from_utf8(cell).is_ok_and(|cell| cell.parse::<f64>().is_ok())
}

fn whole_number(line: &[u8]) -> Option<usize> {
    std::str::from_utf8(line).ok()?.parse().ok()
}

/// A name without quotation marks; those of VeloView's coordinates are x, y and z.
fn name(cell: &[u8]) -> String {
    let text = quoted(cell).replace("\\\"", "\"");
    let plain = text.trim_matches('"').to_ascii_lowercase();
    let axis = VELOVIEW.iter().find_map(|prefix| plain.strip_prefix(prefix));
    let axis = axis.and_then(|axis| ["0", "1", "2"].iter().position(|&number| number == axis));
    axis.map_or(plain, |axis| ["x", "y", "z"][axis].to_owned())
}

fn count_lines(lines: &[u8]) -> usize {
    lines.split(|&byte| byte == b'\n').filter(|line| !line.trim_ascii().is_empty()).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::point_cloud::{OwnPoints, PointCloud};

    fn points(table: ParseResult<Table<'_>>) -> ParseResult<PointCloud> {
        Ok(table?.decode().0)
    }

    #[test]
    fn columns_of_many_writers() {
        for text in [
            "x,y,z,intensity\n1,2,3,9\n4,5,6,8\n",
            "\u{feff}\"X\";\"ring\";\"Y\";\"Z\";\"Intensity\"\r\n1;7;2;3;9\r\n4;7;5;6;8",
            "1 2 3 9\n\n4 5 6 8\n",
            "# x\ty\tz\ti\n1\t2\t3\t9\n4\t5\t6\t8",
            "# made by me\n# x, y, z\nx,y,z,intensity\n1,2,3,9\n4,5,6,8\n",
            "# made by me\n1,2,3,9\n4,5,6,8\n",
            "# x,y,z,intensity\n# m,m,m,-\n1,2,3,9\n4,5,6,8\n",
            "intensity,Points_m_XYZ:0,Points_m_XYZ:1,Points_m_XYZ:2,\n9, 1, 2, 3,\n8, 4, 5, 6,\n",
        ] {
            let cloud = points(parse_csv(text.as_bytes(), &Reading::default())).expect(text);
            assert_eq!(cloud.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], "{text}");
            assert_eq!(cloud.intensity, Some(vec![9.0, 8.0]), "{text}");
        }
    }

    #[test]
    fn tables_of_ousters_sdk() {
        let text = "# frame num: 0\n# TIMESTAMP (ns), ROW, MEASUREMENT_ID, RANGE (mm), REFLECTIVITY (%), \
                    SIGNAL (photons), X1 (m), Y1 (m), Z1 (m)\n\
                    1700000000098242048,5,1006,5480,7,1247,-5.25,-0.5,1.5\n1700000000098342048,6,1006,0,0,0,0,0,0\n";
        let cloud = points(parse_csv(text.as_bytes(), &Reading::default())).expect(text);
        assert_eq!((cloud.points, cloud.num_no_returns), (vec![[-5.25, -0.5, 1.5]], 1));
        assert_eq!((cloud.intensity, cloud.ring), (Some(vec![1247.0]), Some(vec![5])));
        assert!((cloud.time.expect("times")[0] - 1_700_000_000.098_242).abs() < 1e-6);
        let own = |field: &str| Some(OwnPoints { field: field.into(), range: [5.0, 5.0] });
        for field in ["ROW", "ring"] {
            let reading = Reading { own_points: own(field), ..Reading::default() };
            assert_eq!(points(parse_csv(text.as_bytes(), &reading)).expect(field).ring, Some(vec![5]));
        }
        let other = "x,y,z,t,MEASUREMENT_ID,row\n1,2,3,0.5,7,8\n";
        let cloud = points(parse_csv(other.as_bytes(), &Reading::default())).expect(other);
        assert_eq!((cloud.time, cloud.ring), (Some(vec![0.5]), None));
    }

    #[test]
    fn scans_of_leica() {
        let pts = points(parse_pts(b"2\n1 2 3 -9 7 7 7\n4 5 6 8 7 7 7\n", &Reading::default()));
        assert_eq!(pts.expect("PTS").intensity, Some(vec![-9.0, 8.0]));
        let pose = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n5 5 5 1\n";
        let ptx = format!("1\n2\n{pose}0 0 0 0.5\n1 2 3 0.4\n");
        let cloud = points(parse_ptx(ptx.as_bytes(), &Reading::default())).expect("PTX");
        assert_eq!((cloud.points, cloud.num_no_returns), (vec![[1.0, 2.0, 3.0]], 1));
        let two = parse_ptx(format!("{ptx}{ptx}").as_bytes(), &Reading::default()).expect_err("two scans");
        assert_eq!(two, "holds 14 lines of points, its header promises 2 of one scan");
    }

    #[test]
    fn what_is_no_table_is_refused() {
        let complaints = [
            ("x,y,z\n1,,3\n", "point 0: found too few values"),
            ("x;y;z\n1,5;2;3\n", "point 0: found '1,5', needs a number"),
            ("a,b\n1,2\n", "has the fields a b, needs x, y and z"),
            (
                "1,2,3,4,5\n",
                "has 5 columns without names, needs x y z or x y z intensity, or a .csv with a line of names",
            ),
            (
                "",
                "has 0 columns without names, needs x y z or x y z intensity, or a .csv with a line of names",
            ),
        ];
        for (text, complaint) in complaints {
            assert_eq!(parse_csv(text.as_bytes(), &Reading::default()).expect_err(text), complaint);
        }
        assert!(
            parse_pts(b"x y z\n", &Reading::default()).is_err_and(|error| error.starts_with("is not a PTS"))
        );
        assert!(
            parse_pts(b"1\n1 2 3\n4 5 6\n", &Reading::default())
                .is_err_and(|error| error.contains("promises 1"))
        );
    }
}
