//! Reading ends for any bytes of a file, with a cloud or with an error message of one line.

use proptest::prelude::*;

use super::limit::ParseResult;
use super::*;

const PCD: &str = "# made\nVERSION 0.7\nFIELDS x y z _ label t ring\nSIZE 4 4 4 1 2 4 1\nTYPE F F F U U U U\n\
                   COUNT 1 1 1 3 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ";
const PLY: &str = "element face 2\nproperty list uchar ushort corners\nproperty int flag\nelement vertex 2\n\
                   property float x\nproperty float y\nproperty list uint float more\nproperty double z\n\
                   property uchar label\nend_header\n";
const TEXT: &str = "2 0 1 5\n0 6\n1 2 0 3 4\n5 6 1 9 7 8\n";

fn npy(header: &str, data: &[u8]) -> Vec<u8> {
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
}

fn seeds() -> Vec<(Format, Vec<u8>)> {
    let record = [&[0, 0, 128, 63].repeat(3)[..], &[1; 10]].concat();
    let two = record.repeat(2);
    let literal = [&[31][..], &two[..32], &[11], &two[32..]].concat();
    let sizes = [literal.len() as u32, two.len() as u32].map(u32::to_le_bytes).concat();
    let faces = [2, 1, 1, 1, 1, 5, 5, 5, 5, 0, 8, 8, 8, 8];
    let vertices = |one: [u8; 4]| {
        let (first, second) =
            ([&[1; 8][..], &[0; 4], &[1; 9]].concat(), [&[2; 8][..], &one, &[3; 13]].concat());
        [&faces[..], &first, &second].concat()
    };
    let pcd = |encoding: &str, data: &[u8]| {
        (Format::Pcd, [PCD.as_bytes(), encoding.as_bytes(), b"\n", data].concat())
    };
    let ply = |encoding: &str, data: &[u8]| {
        (Format::Ply, [format!("ply\nformat {encoding} 1.0\n{PLY}").as_bytes(), data].concat())
    };
    let records = "{'descr': [('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('rest', '|u1', (10,))], \
                   'fortran_order': False, 'shape': (2,)}\n";
    vec![
        pcd("ascii", b"1 2 3 0 0 0 4 5 6\nnan 8 9 0 0 0 1 2 3\n"),
        pcd("binary", &two),
        pcd("binary_compressed", &[sizes, literal].concat()),
        ply("ascii", TEXT.as_bytes()),
        ply("binary_big_endian", &vertices(1u32.to_be_bytes())),
        ply("binary_little_endian", &vertices(1u32.to_le_bytes())),
        (Format::Npy, npy(records, &[&two[..12], &two[..32]].concat())),
        (Format::Npy, npy("{'descr': '>f8', 'fortran_order': True, 'shape': (2, 3)}\n", &[64; 48])),
        (Format::Kitti, vec![63; 32]),
        (Format::NuScenes, vec![63; 40]),
        (Format::Csv, b"x,y,z,ring\n1,2,3,4\n5,6,7,8\n".to_vec()),
        (Format::Pts, b"2\n1 2 3 4\n5 6 7 8\n".to_vec()),
    ]
}

/// Checks that a message is one line, and short enough for a terminal.
fn check(result: ParseResult<PointCloud>) {
    if let Err(complaint) = result {
        assert!(!complaint.contains(char::is_control) && complaint.len() < 1000, "{complaint:?}");
    }
}

#[test]
fn the_seeds_are_read() {
    for (format, bytes) in seeds() {
        let cloud = decode(format, &bytes);
        assert!(cloud.is_ok(), "{format:?}: {cloud:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn damaged_files(
        seed in any::<prop::sample::Index>(),
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let (format, mut bytes) = seeds()[seed.index(seeds().len())].clone();
        for (place, byte) in edits {
            let place = place.index(bytes.len());
            bytes[place] = byte;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        check(decode(format, &bytes));
    }

    #[test]
    fn noise(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let text = [Format::Csv, Format::Pts, Format::Ptx];
        for format in [Format::Kitti, Format::NuScenes, Format::Pcd, Format::Ply, Format::Npy].into_iter().chain(text) {
            check(decode(format, &bytes));
        }
        check_unpacked(&bytes);
    }
}

fn check_unpacked(bytes: &[u8]) {
    for size in [0, 1, 100, 10_000] {
        let unpacked = lzf::decompress(bytes, size);
        assert!(unpacked.is_err() || unpacked.is_ok_and(|found| found.len() == size));
    }
}

/// A header that promises 10^12 points gets no memory, but an error.
#[test]
fn promises_of_a_million_million_points() {
    const MANY: &str = "1000000000000";
    const TOO_MANY: &str = "found 1,000,000,000,000 points, needed at most 10,000,000: see --max-points";
    let pcd = |encoding: &str| {
        let header =
            PCD.replace("WIDTH 2", &format!("WIDTH {MANY}")).replace("POINTS 2", &format!("POINTS {MANY}"));
        (Format::Pcd, format!("{header}{encoding}\n1 2 3 4 5 6 7 8 9 0").into_bytes())
    };
    let ply = |encoding: &str| {
        let header = PLY.replace("vertex 2", &format!("vertex {MANY}")).replace("face 2", "face 0");
        (Format::Ply, format!("ply\nformat {encoding} 1.0\n{header}1 2 0 3 4").into_bytes())
    };
    let shape = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({MANY}, 3)}}");
    let cases = [
        (pcd("ascii"), TOO_MANY),
        (pcd("binary"), TOO_MANY),
        (pcd("binary_compressed"), TOO_MANY),
        (ply("ascii"), TOO_MANY),
        (ply("binary_big_endian"), TOO_MANY),
        (
            (Format::Npy, npy(&shape, &[0; 12])),
            "holds 12 bytes of data, its header needs shape [1000000000000, 3] of <f4",
        ),
    ];
    for ((format, bytes), complaint) in cases {
        assert_eq!(decode(format, &bytes), Err(complaint.into()));
    }
}

/// Cases found by inspection or by fuzzing.
#[test]
fn headers_that_are_none() {
    let pcd = |from: &str, to: &str| {
        (Format::Pcd, format!("{}ascii\n1 2 3 0 0 0 4 5 6\n", PCD.replace(from, to)).into_bytes())
    };
    let npy = |header: &str| (Format::Npy, npy(header, &[]));
    let mut long_npy = b"\x93NUMPY\x02\x00\xff\xff\xff\xff".to_vec();
    long_npy.extend([b' '; 100]);
    let cases = [
        (pcd("WIDTH 2", "WIDTH 3"), "its header promises 2 points and 3 x 1 of them"),
        (pcd("VERSION 0.7", "VERSION 0.8"), "has version '0.8', needs 0.5, 0.6 or 0.7"),
        (pcd("POINTS 2", "POINTS -2"), "header line 'POINTS -2' needs whole numbers"),
        (pcd("SIZE 4 4 4 1", "SIZE 4 4 4"), "its SIZE line has 6 values for 7 fields"),
        (
            pcd("SIZE 4 4 4", "SIZE 4 2 4"),
            "field y is TYPE F SIZE 2 COUNT 1, needs one float or integer of a usual size",
        ),
        (
            pcd("COUNT 1", "COUNT 9"),
            "field x is TYPE F SIZE 4 COUNT 9, needs one float or integer of a usual size",
        ),
        (pcd("x y z", "x y q"), "has the fields x y q _ label t ring, needs x, y and z"),
        (pcd("# made", "\u{7}bell"), "header line '\\u{7}bell' is not known"),
        (pcd("HEIGHT 1", "HEIGHT 1 1"), "header line 'HEIGHT 1 1' needs one number"),
        ((Format::Pcd, vec![b'#'; 1 << 20]), "is not a PCD file: its header has no DATA line"),
        (
            (Format::Ply, vec![b'p'; 1 << 20]),
            "is not a PLY file: it has no header from 'ply' to 'end_header'",
        ),
        ((Format::Ply, b"ply\nend_header\n".to_vec()), "its header has no format"),
        ((Format::Ply, b"ply\nformat ascii 1.0\nend_header\n".to_vec()), "has no element 'vertex'"),
        ((Format::Ply, b"ply\nelement vertex -1\n".to_vec()), "header line 'element vertex -1' is not known"),
        ((Format::Ply, b"ply\nproperty float x\n".to_vec()), "header line 'property float x' is not known"),
        (npy(&"[".repeat(5000)), "is not a .npy array: its header is nested too deeply"),
        ((Format::Npy, long_npy), "is not a .npy array: its header is too long"),
        ((Format::Kitti, vec![0; 32]), "holds no returns: every point is zero or not finite"),
        ((Format::Kitti, vec![]), "holds no points"),
    ];
    for ((format, bytes), complaint) in cases {
        assert_eq!(decode(format, &bytes), Err(complaint.into()));
    }
}
