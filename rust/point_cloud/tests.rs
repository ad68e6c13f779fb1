use super::*;

fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let path = std::env::temp_dir().join(format!("semcal_{}_{name}", std::process::id()));
    std::fs::write(&path, bytes).expect("a writable temporary folder");
    path
}

fn bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

#[test]
fn no_returns_are_dropped_with_their_labels() {
    let values = [1.0, 2.0, 3.0, 0.5, 0.0, 0.0, 0.0, 0.0, f32::NAN, 1.0, 1.0, 1.0, 4.0, 5.0, 6.0, 0.7];
    let points = file("a.bin", &bytes(&values));
    let ids = [7u32, 8, 9, 10 | (3 << 16)];
    let labels = file("a.label", &ids.map(u32::to_le_bytes).concat());
    let cloud = read(&points, Some(&labels), Limit::default()).expect("a valid cloud");
    assert_eq!(cloud.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    assert_eq!(cloud.labels, Some(vec![7, 10]), "the instance in the high bits is dropped");
    assert_eq!(cloud.intensity, Some(vec![0.5, 0.7]));
    assert_eq!(cloud.num_no_returns, 2);
}

#[test]
fn counts_that_disagree_name_both_files() {
    let points = file("b.bin", &bytes(&[1.0; 8]));
    let labels = file("b.label", &[0; 12]);
    let message = read(&points, Some(&labels), Limit::default()).expect_err("3 labels, 2 points").to_string();
    assert!(message.ends_with(&format!("3 labels for the 2 points of {}", points.display())), "{message}");
    let message = read(&labels, None, Limit::default()).expect_err("no cloud").to_string();
    assert!(
        message.ends_with(
            "format 'label' is not known, needs .bin, .pcd.bin, .pcd, .ply, .npy, .npz, .las or .laz"
        ),
        "{message}"
    );
    let odd = file("c.bin", &[0; 1921]);
    let message = read(&odd, None, Limit::default()).expect_err("odd size").to_string();
    assert!(message.ends_with("1921 bytes is not a multiple of 16"), "{message}");
}
