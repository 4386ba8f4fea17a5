//! Maps in the binary form of glTF 2.0 (Khronos Group, ISO/IEC 12113:2022): one file for viewers in a browser, Blender and game
//! engines.

use nalgebra::Vector3;
use serde_json::{Value, json};

use super::map::{SpatialMap, SurfacePoint, colour};

/// Type of the components of an accessor, by the numbers of OpenGL.
const UNSIGNED_BYTE: u32 = 5121;
const FLOAT: u32 = 5126;

/// Primitives without edges.
const POINTS: u32 = 0;

/// Rotation of World, whose z axis points upwards, to glTF, whose y axis does: x, y, z and scalar part of a unit quaternion.
const UPRIGHT: [f64; 4] = [-std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2];

/// The attributes of a primitive in one buffer.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Adds an attribute, whose components take whole groups of four bytes. Returns the index of its accessor.
    fn add(&mut self, bytes: impl Iterator<Item = u8>, accessor: Value) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(bytes);
        self.views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": self.bytes.len() - start}));
        let mut accessor = accessor;
        accessor["bufferView"] = json!(self.views.len() - 1);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

impl SpatialMap {
    /// The points in the format GLB: coordinates (m) relative to their mean, which is the position of the node, normal, colour by the
    /// standard deviation as in [`SpatialMap::to_ply`], and the attributes `_SD_M` (m), `_ESTIMATES` and `_OBJECT`. A map without
    /// points is a scene without a mesh.
    pub fn to_glb(&self) -> Vec<u8> {
        let count = self.points.len();
        let mut document = json!({
            "asset": {"version": "2.0", "generator": concat!("whisker ", env!("CARGO_PKG_VERSION"))},
            "scene": 0,
            "scenes": [{"nodes": []}],
        });
        let mut buffer = Buffer::default();
        if count > 0 {
            // Single precision suffices for coordinates relative to the mean.
            let middle = self.points.iter().map(|point| point.at).sum::<Vector3<f64>>() / count as f64;
            let places: Vec<[f32; 3]> =
                self.points.iter().map(|point| (point.at - middle).map(|m| m as f32).into()).collect();
            let extreme = |pick: fn(f32, f32) -> f32| -> [f32; 3] {
                std::array::from_fn(|axis| places.iter().map(|place| place[axis]).reduce(pick).unwrap_or_default())
            };
            let vectors = |kind: &str| json!({"componentType": FLOAT, "count": count, "type": kind});
            let mut position = vectors("VEC3");
            (position["min"], position["max"]) = (json!(extreme(f32::min)), json!(extreme(f32::max)));
            let numbers = |of: fn(&SurfacePoint) -> f64| self.points.iter().map(move |point| of(point) as f32);
            let bytes = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
            let normals: Vec<f32> =
                self.points.iter().flat_map(|point| point.normal.map(|n| n as f32).data.0[0]).collect();
            let colours = self.points.iter().flat_map(|point| {
                let [red, green, blue] = colour(point.sd_m());
                [red, green, blue, u8::MAX]
            });
            let coloured = json!({"componentType": UNSIGNED_BYTE, "normalized": true, "count": count, "type": "VEC4"});
            let deviations: Vec<f32> = numbers(SurfacePoint::sd_m).collect();
            let estimates = self.points.iter().flat_map(|point| (point.estimates as f32).to_le_bytes());
            let objects = self.points.iter().flat_map(|point| (point.object as f32).to_le_bytes());
            let attributes = json!({
                "POSITION": buffer.add(bytes(places.as_flattened()).into_iter(), position),
                "NORMAL": buffer.add(bytes(&normals).into_iter(), vectors("VEC3")),
                "COLOR_0": buffer.add(colours, coloured),
                "_SD_M": buffer.add(bytes(&deviations).into_iter(), vectors("SCALAR")),
                "_ESTIMATES": buffer.add(estimates, vectors("SCALAR")),
                "_OBJECT": buffer.add(objects, vectors("SCALAR")),
            });
            let turned = Vector3::new(middle.x, middle.z, -middle.y);
            document["scenes"][0]["nodes"] = json!([0]);
            document["nodes"] =
                json!([{"mesh": 0, "rotation": UPRIGHT, "translation": [turned.x, turned.y, turned.z]}]);
            document["meshes"] = json!([{"primitives": [{"mode": POINTS, "attributes": attributes}]}]);
            document["buffers"] = json!([{"byteLength": buffer.bytes.len()}]);
            document["bufferViews"] = json!(buffer.views);
            document["accessors"] = json!(buffer.accessors);
        }
        container(document.to_string().into_bytes(), buffer.bytes)
    }
}

/// The file: header, chunk of the document and, if there is one, chunk of the buffer, each in whole groups of four bytes.
fn container(document: Vec<u8>, buffer: Vec<u8>) -> Vec<u8> {
    let chunk = |mut bytes: Vec<u8>, kind: &[u8; 4], padding: u8| {
        bytes.resize(bytes.len().next_multiple_of(4), padding);
        let mut chunk = (bytes.len() as u32).to_le_bytes().to_vec();
        chunk.extend(kind);
        chunk.extend(bytes);
        chunk
    };
    let mut chunks = chunk(document, b"JSON", b' ');
    if !buffer.is_empty() {
        chunks.extend(chunk(buffer, b"BIN\0", 0));
    }
    let mut file = b"glTF".to_vec();
    file.extend(2_u32.to_le_bytes());
    file.extend((chunks.len() as u32 + 12).to_le_bytes());
    file.extend(chunks);
    file
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    fn number(bytes: &[u8], at: usize) -> usize {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
    }

    fn point(at: [f64; 3], sd_m: f64) -> SurfacePoint {
        let covariance_m2 = Matrix3::identity() * (sd_m * sd_m / 3.0);
        SurfacePoint { at: at.into(), normal: Vector3::y(), covariance_m2, estimates: 3, object: 1 }
    }

    /// Document and buffer of a file whose lengths are right.
    fn parts(file: &[u8]) -> (Value, Vec<u8>) {
        assert_eq!((&file[..4], number(file, 4), number(file, 8)), (&b"glTF"[..], 2, file.len()));
        let end = 20 + number(file, 12);
        assert_eq!(&file[16..20], b"JSON");
        let buffer = match file.get(end..end + 8) {
            Some(head) => {
                assert!(&head[4..] == b"BIN\0" && end + 8 + number(file, end) == file.len());
                file[end + 8..].to_vec()
            }
            None => Vec::new(),
        };
        (serde_json::from_slice(&file[20..end]).unwrap(), buffer)
    }

    #[test]
    fn verif_a_map_is_written_as_glb() {
        let points = vec![point([1.0, 2.0, 3.0], 1e-5), point([1.002, 2.0, 3.004], 1e-3)];
        let (document, buffer) = parts(&SpatialMap { points, ..SpatialMap::default() }.to_glb());
        let primitive = &document["meshes"][0]["primitives"][0];
        let of = |name: &str| {
            let accessor = &document["accessors"][primitive["attributes"][name].as_u64().unwrap() as usize];
            assert_eq!(accessor["count"], 2);
            let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
            let start = view["byteOffset"].as_u64().unwrap() as usize;
            buffer[start..start + view["byteLength"].as_u64().unwrap() as usize].to_vec()
        };
        let floats = |name: &str| -> Vec<f32> {
            of(name).chunks(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect()
        };
        assert_eq!(floats("POSITION"), [-1e-3, 0.0, -2e-3, 1e-3, 0.0, 2e-3]);
        assert_eq!(floats("NORMAL"), [0.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
        assert_eq!(of("COLOR_0"), [68, 1, 84, 255, 253, 231, 37, 255]);
        assert!((floats("_SD_M")[1] - 1e-3).abs() < 1e-9 && floats("_OBJECT") == [1.0, 1.0]);
        // The mean (1.001, 2, 3.002) with y upwards.
        let place: Vec<f64> = serde_json::from_value(document["nodes"][0]["translation"].clone()).unwrap();
        let expected = [1.001, 3.002, -2.0];
        assert!(place.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-12), "{place:?}");
        assert_eq!(document["buffers"][0]["byteLength"], buffer.len());
    }

    #[test]
    fn robust_a_map_without_points_is_a_scene_without_a_mesh() {
        let (document, buffer) = parts(&SpatialMap::default().to_glb());
        assert!(buffer.is_empty() && document.get("meshes").is_none() && document["scenes"][0]["nodes"] == json!([]));
    }
}
