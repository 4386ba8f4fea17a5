//! Writing and reading of recordings, and reading of damaged ones.

use std::fs;
use std::path::{Path, PathBuf};

use bag::messages::{AnyMessage, Float64, Header, MagneticField, MagneticFieldArray, TfMessage, Time, Vector3};
use bag::{Error, Message, Publisher, Reader, Writer, topics};
use proptest::prelude::*;

const PERIOD_NS: u64 = 1_250_000;

fn field(i: u64) -> MagneticField {
    MagneticField {
        header: Header { stamp: Time::from_nanoseconds(i * PERIOD_NS), frame_id: topics::WHISKER.into() },
        magnetic_field: Vector3 { x: i as f64, y: -0.5 * i as f64, z: 1e-9 },
        magnetic_field_covariance: [0.0; 9],
    }
}

fn write(folder: &Path, messages: u64) {
    let mut writer = Writer::create(folder).unwrap();
    writer.write(topics::TF_STATIC, 0, &TfMessage::default()).unwrap();
    for i in 0..messages {
        let readings = MagneticFieldArray { magnetic_field_array: vec![field(i), field(i + 1)] };
        writer.write(topics::MAGNETOMETER, i * PERIOD_NS, &readings).unwrap();
    }
    writer.attach("note.txt", "text/plain", b"a note").unwrap();
    writer.finish().unwrap();
}

/// Number of messages up to the end or the first error of a recording, and the error.
fn read_all(path: &Path) -> (usize, Option<Error>) {
    let reader = match Reader::open(path) {
        Ok(reader) => reader,
        Err(error) => return (0, Some(error)),
    };
    let mut read = 0;
    for record in reader.records() {
        match record.and_then(|record| record.decode_any()) {
            Ok(_) => read += 1,
            Err(error) => return (read, Some(error)),
        }
    }
    (read, reader.attachments().err())
}

fn mcap_of(folder: &Path) -> PathBuf {
    folder.join("run_0.mcap")
}

#[test]
fn verif_written_messages_are_read() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("run");
    write(&folder, 5000);
    for path in [folder.clone(), folder.join("metadata.yaml"), mcap_of(&folder)] {
        let reader = Reader::open(&path).unwrap();
        let records: Vec<_> = reader.records().collect::<Result<_, _>>().unwrap();
        assert_eq!(records.len(), 5001);
        assert_eq!(records[0].topic, topics::TF_STATIC);
        for (i, record) in (0..).zip(&records[1..]) {
            let readings: MagneticFieldArray = record.decode().unwrap();
            assert_eq!(readings.magnetic_field_array, [field(i), field(i + 1)]);
            assert_eq!(record.time_ns, i * PERIOD_NS);
            assert_eq!(record.decode_any().unwrap(), Some(AnyMessage::MagneticFieldArray(readings)));
        }
        let attachments = reader.attachments().unwrap();
        assert_eq!((attachments[0].name.as_str(), attachments[0].data.as_slice()), ("note.txt", &b"a note"[..]));
    }
}

#[test]
fn verif_same_bytes_each_time() {
    let home = tempfile::tempdir().unwrap();
    let folders = ["a", "b"].map(|name| home.path().join(name).join("run"));
    for folder in &folders {
        write(folder, 300);
    }
    for file in ["run_0.mcap", "metadata.yaml"] {
        assert_eq!(fs::read(folders[0].join(file)).unwrap(), fs::read(folders[1].join(file)).unwrap(), "{file}");
    }
}

#[test]
fn robust_a_truncated_recording_is_read_up_to_the_cut() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("run");
    write(&folder, 5000);
    let bytes = fs::read(mcap_of(&folder)).unwrap();
    let part = home.path().join("run.part");
    fs::create_dir(&part).unwrap();
    fs::write(mcap_of(&part), &bytes[..bytes.len() / 2]).unwrap();
    let (read, error) = read_all(&part);
    assert!(read > 1000, "{read}");
    let message = error.unwrap().to_string();
    assert!(message.contains(&format!("after message {read}")), "{message}");
    // It is not overwritten.
    fs::remove_dir_all(&folder).unwrap();
    let message = Writer::create(&folder).err().unwrap().to_string();
    assert!(message.contains("run.part"), "{message}");
}

/// An MCAP file of these records, without chunks: opcode and body of each.
fn mcap_of_records(records: &[(u8, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = mcap::MAGIC.to_vec();
    for (opcode, body) in records {
        bytes.push(*opcode);
        bytes.extend((body.len() as u64).to_le_bytes());
        bytes.extend(body);
    }
    bytes.extend(mcap::MAGIC);
    bytes
}

/// Text after its length, as in MCAP.
fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
}

#[test]
fn robust_lengths_and_ids_are_checked() {
    let home = tempfile::tempdir().unwrap();
    let claimed = u32::MAX.to_le_bytes().to_vec();
    let schema = |id: u16, name: &str| (3, [&id.to_le_bytes()[..], &text(name), &text("ros2msg"), &text("")].concat());
    let channel = |id: u16, schema: u16, topic: &str| {
        (4, [&id.to_le_bytes()[..], &schema.to_le_bytes(), &text(topic), &text("cdr"), &text("")].concat())
    };
    let message = |channel: u16| (5, [&channel.to_le_bytes()[..], &[0; 20]].concat());
    let end = (15, vec![0; 4]);
    let unfit = "found MCAP file ended in the middle of a record";
    let cases = [
        (vec![(3, [&[1, 0][..], &claimed].concat())], unfit),
        (vec![(4, [&[1, 0, 0, 0][..], &text("/a"), &claimed].concat())], unfit),
        (vec![(4, [&[1, 0, 0, 0][..], &text("/a"), &text("cdr"), &[4, 0, 0, 0], &claimed].concat())], unfit),
        (vec![schema(1, "a/msg/A"), schema(1, "a/msg/B")], "a/msg/B"),
        (vec![channel(1, 0, "/a"), channel(1, 0, "/b")], "/b"),
        (vec![channel(1, 7, "/a"), message(1)], "/a"),
        (vec![message(1)], "channel"),
        (vec![channel(1, 0, "/a"), end, message(1)], "channel"),
    ];
    for (i, (records, words)) in cases.into_iter().enumerate() {
        let file = home.path().join(format!("{i}.mcap"));
        fs::write(&file, mcap_of_records(&records)).unwrap();
        let message = read_all(&file).1.expect("an error").to_string();
        assert!(message.contains(words), "{i}: {message}");
    }
    let file = home.path().join("attachment.mcap");
    fs::write(&file, mcap_of_records(&[(9, [&[0; 16][..], &claimed].concat()), (9, vec![0; 3])])).unwrap();
    let message = Reader::open(&file).unwrap().attachments().unwrap_err().to_string();
    assert!(message.contains(unfit), "{message}");
}

/// Body of a chunk record of these records: opcode and body of each.
fn chunk(compression: &str, length: u64, compressed: &[u8]) -> (u8, Vec<u8>) {
    let head = [&[0; 16][..], &length.to_le_bytes(), &[0; 4], &text(compression)].concat();
    (6, [&head[..], &(compressed.len() as u64).to_le_bytes(), compressed].concat())
}

fn compressed(compression: &str, bytes: &[u8]) -> Vec<u8> {
    match compression {
        "zstd" => ruzstd::encoding::compress_to_vec(bytes, ruzstd::encoding::CompressionLevel::Fastest),
        "lz4" => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            std::io::Write::write_all(&mut encoder, bytes).unwrap();
            encoder.finish().unwrap()
        }
        _ => bytes.to_vec(),
    }
}

#[test]
fn val_chunks_compressed_by_python_are_read() {
    for compression in ["zstd", "lz4"] {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/{compression}.mcap"));
        let reader = Reader::open(&file).unwrap();
        let records: Vec<_> = reader.records().collect::<Result<_, _>>().unwrap();
        assert_eq!(records.len(), 1000, "{compression}");
        for (i, record) in (0_u32..).zip(&records) {
            let expected = (f64::from(i) * 0.37) % 1.0 - 0.5;
            assert_eq!(record.decode::<Float64>().unwrap().data, expected, "{compression}: {i}");
            assert_eq!(record.time_ns, u64::from(i) * PERIOD_NS);
        }
        assert_eq!(reader.attachments().unwrap()[0].data, b"a note");
    }
}

#[test]
fn robust_chunks_are_bounded_and_checked() {
    let home = tempfile::tempdir().unwrap();
    let error = |name: &str, chunk: (u8, Vec<u8>)| {
        let file = home.path().join(name);
        fs::write(&file, mcap_of_records(&[chunk])).unwrap();
        read_all(&file).1.expect("an error").to_string()
    };
    // A record of an unknown opcode, filled with zeros.
    let record = [&[0x80][..], &10_000_u64.to_le_bytes(), &vec![0; 10_000]].concat();
    let length = record.len() as u64;
    for compression in ["", "zstd", "lz4"] {
        let good = compressed(compression, &record);
        let file = home.path().join("good.mcap");
        let end = [(15, vec![0; 4]), (2, vec![0; 20])];
        fs::write(&file, mcap_of_records(&[&[chunk(compression, length, &good)][..], &end].concat())).unwrap();
        let read = read_all(&file);
        assert!(read.0 == 0 && read.1.is_none(), "{compression}: {read:?}");
        let claimed = error("claimed.mcap", chunk(compression, u64::MAX, &good));
        assert!(claimed.contains(&u64::MAX.to_string()), "{compression}: {claimed}");
        let differs = error("differs.mcap", chunk(compression, length + 1, &good));
        assert!(differs.contains(&(length + 1).to_string()), "{compression}: {differs}");
        let unfilled = compressed(compression, &record[..5000]);
        let unfilled = error("unfilled.mcap", chunk(compression, 5000, &unfilled));
        assert!(unfilled.contains("ended in the middle of a record"), "{compression}: {unfilled}");
        if !compression.is_empty() {
            let cut = error("cut.mcap", chunk(compression, length, &good[..good.len() / 2]));
            assert!(!cut.is_empty(), "{compression}");
        }
    }
    let unknown = error("unknown.mcap", chunk("brotli", 3, b"abc"));
    assert!(unknown.contains("brotli"), "{unknown}");
    // Decompression bomb: 64 MiB of zeros in a few KiB, more than a thousand times the length of the file.
    let zeros = vec![0; 1 << 26];
    let bomb = error("bomb.mcap", chunk("zstd", 1 << 26, &compressed("zstd", &zeros)));
    assert!(bomb.contains(&(1_u64 << 26).to_string()), "{bomb}");
}

#[test]
fn robust_metadata_and_recording_must_agree() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("run");
    write(&folder, 10);
    let metadata = folder.join("metadata.yaml");
    let text = fs::read_to_string(&metadata).unwrap();
    let expect = |changed: &str, words: &str| {
        fs::write(&metadata, changed).unwrap();
        let message = read_all(&folder).1.unwrap().to_string();
        assert!(message.contains(words), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    };
    expect(&text.replace("message_count: 11", "message_count: 12"), "found 11, expected 12");
    expect(
        &text.replace("storage_identifier: mcap", "storage_identifier: sqlite3"),
        "found `sqlite3`, expected `mcap`",
    );
    expect(&text.replace("- run_0.mcap", "- ../run_0.mcap"), "expected a path within the folder");
    expect(&text.replace("- run_0.mcap", "- run_1.mcap"), "run_1.mcap");
    expect("rosbag2_bagfile_information: [", "metadata of a rosbag2 folder");
}

#[test]
fn robust_one_type_per_topic() {
    let home = tempfile::tempdir().unwrap();
    let mut writer = Writer::create(&home.path().join("run")).unwrap();
    writer.write("/a", 0, &Time::default()).unwrap();
    let message = writer.write("/a", 1, &Vector3::default()).unwrap_err().to_string();
    assert!(message.contains("expected builtin_interfaces/msg/Time, as before"), "{message}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Flipped bytes, cuts and insertions: read or refused in one line, never a panic.
    #[test]
    fn robust_damaged_recordings(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("run");
        write(&folder, 40);
        let file = mcap_of(&folder);
        let mut bytes = fs::read(&file).unwrap();
        for (place, byte) in &changes {
            let place = place.index(bytes.len());
            bytes[place] = *byte;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        fs::write(&file, &bytes).unwrap();
        let (read, error) = read_all(&folder);
        prop_assert!(read == 41 || error.is_some());
        if let Some(error) = error {
            prop_assert_eq!(error.to_string().lines().count(), 1);
        }
    }

    /// Damaged compressed chunks: read or refused in one line, never a panic.
    #[test]
    fn robust_damaged_chunks(
        compression in prop::sample::select(vec!["zstd", "lz4"]),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        let home = tempfile::tempdir().unwrap();
        let mut bytes = fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/{compression}.mcap"))).unwrap();
        for (place, byte) in &changes {
            let place = place.index(bytes.len());
            bytes[place] = *byte;
        }
        let file = home.path().join("damaged.mcap");
        fs::write(&file, &bytes).unwrap();
        let (read, error) = read_all(&file);
        prop_assert!(read <= 1000);
        if let Some(error) = error {
            prop_assert_eq!(error.to_string().lines().count(), 1);
        }
    }

    /// Damaged messages of every known type: read or refused, never a panic.
    #[test]
    fn robust_damaged_messages(
        bytes in prop::collection::vec(any::<u8>(), 0..300),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
    ) {
        let mut good = MagneticFieldArray { magnetic_field_array: vec![field(1), field(2)] }.encode();
        for (place, byte) in &changes {
            let place = place.index(good.len());
            good[place] = *byte;
        }
        for name in AnyMessage::TYPES {
            let _ = AnyMessage::decode(name, &bytes);
            let _ = AnyMessage::decode(name, &good);
        }
    }

    /// Damaged metadata: read or refused, never a panic.
    #[test]
    fn robust_damaged_metadata(text in "[a-z_0-9: \\-\\[\\]{}\"&*!\n]{0,200}") {
        let home = tempfile::tempdir().unwrap();
        fs::write(home.path().join("metadata.yaml"), format!("rosbag2_bagfile_information:\n{text}")).unwrap();
        prop_assert!(read_all(home.path()).1.is_some());
    }
}
