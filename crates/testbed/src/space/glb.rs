//! Maps in the binary form of glTF 2.0 (Khronos Group, ISO/IEC 12113:2022): one file for viewers in a browser, Blender and game
//! engines.

use nalgebra::Vector3;
use serde_json::{Value, json};
use whisker::space::surface::ProjectedPoint;

use super::map::{SpatialMap, SurfacePoint, colour};
use super::surface::{SurfaceMesh, Vertex};

/// Type of the components of an accessor, by the numbers of OpenGL.
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// Kinds of primitives.
const POINTS: u32 = 0;
const TRIANGLES: u32 = 4;

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

/// Attributes of a point or vertex.
struct PointAttributes {
    at: Vector3<f64>,
    normal: Vector3<f64>,
    sd_m: f64,
    object: usize,
}

impl Buffer {
    /// Adds a scalar attribute in single precision. Returns the index of its accessor.
    fn add_scalars(&mut self, values: impl ExactSizeIterator<Item = f64>) -> usize {
        let accessor = json!({"componentType": FLOAT, "count": values.len(), "type": "SCALAR"});
        self.add(values.flat_map(|value| (value as f32).to_le_bytes()), accessor)
    }

    /// Adds the attributes of points or vertices, with coordinates relative to `middle`.
    fn add_points(&mut self, points: &[PointAttributes], middle: Vector3<f64>) -> Value {
        let places: Vec<[f32; 3]> = points.iter().map(|point| (point.at - middle).map(|m| m as f32).into()).collect();
        let extreme = |pick: fn(f32, f32) -> f32| -> [f32; 3] {
            std::array::from_fn(|axis| places.iter().map(|place| place[axis]).reduce(pick).unwrap_or_default())
        };
        let vectors = |kind: &str| json!({"componentType": FLOAT, "count": points.len(), "type": kind});
        let mut position = vectors("VEC3");
        (position["min"], position["max"]) = (json!(extreme(f32::min)), json!(extreme(f32::max)));
        let normals: Vec<[f32; 3]> = points.iter().map(|point| point.normal.map(|n| n as f32).into()).collect();
        let bytes = |values: &[[f32; 3]]| {
            values.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>()
        };
        let colours = points.iter().flat_map(|point| {
            let [red, green, blue] = colour(point.sd_m);
            [red, green, blue, u8::MAX]
        });
        let coloured =
            json!({"componentType": UNSIGNED_BYTE, "normalized": true, "count": points.len(), "type": "VEC4"});
        json!({
            "POSITION": self.add(bytes(&places).into_iter(), position),
            "NORMAL": self.add(bytes(&normals).into_iter(), vectors("VEC3")),
            "COLOR_0": self.add(colours, coloured),
            "_SD_M": self.add_scalars(points.iter().map(|point| point.sd_m)),
            "_OBJECT": self.add_scalars(points.iter().map(|point| point.object as f64)),
        })
    }
}

impl SpatialMap {
    /// The points and the triangles of the surface in the format GLB: coordinates (m) relative to the mean of the points, which is
    /// the position of the node, normal, colour by the standard deviation as in [`SpatialMap::to_ply`], and the attributes `_SD_M`
    /// (m), `_OBJECT` and, for points, `_ESTIMATES`. A map without points is a scene without a mesh.
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
            let attributes_of = |point: &SurfacePoint| {
                let SurfacePoint { at, normal, object, .. } = *point;
                PointAttributes { at, normal, sd_m: point.sd_m(), object }
            };
            let of_points: Vec<PointAttributes> = self.points.iter().map(attributes_of).collect();
            let mut attributes = buffer.add_points(&of_points, middle);
            attributes["_ESTIMATES"] =
                json!(buffer.add_scalars(self.points.iter().map(|point| point.estimates as f64)));
            let mut primitives = vec![json!({"mode": POINTS, "attributes": attributes})];
            let SurfaceMesh { vertices, triangles } = &self.surface;
            if !triangles.is_empty() {
                let attributes_of = |vertex: &Vertex| {
                    let Vertex { on: ProjectedPoint { at, normal, sd_m }, object } = *vertex;
                    PointAttributes { at: at.vector(), normal, sd_m, object }
                };
                let of_vertices: Vec<PointAttributes> = vertices.iter().map(attributes_of).collect();
                let attributes = buffer.add_points(&of_vertices, middle);
                let corners = triangles.as_flattened();
                let accessor = json!({"componentType": UNSIGNED_INT, "count": corners.len(), "type": "SCALAR"});
                let indices = buffer.add(corners.iter().flat_map(|corner| corner.to_le_bytes()), accessor);
                primitives.push(json!({"mode": TRIANGLES, "attributes": attributes, "indices": indices}));
            }
            let turned = Vector3::new(middle.x, middle.z, -middle.y);
            document["scenes"][0]["nodes"] = json!([0]);
            document["nodes"] =
                json!([{"mesh": 0, "rotation": UPRIGHT, "translation": [turned.x, turned.y, turned.z]}]);
            document["meshes"] = json!([{"primitives": primitives}]);
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
    use whisker::space::frames::Point;

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
        let vertex = |z_m: f64| Vertex {
            on: ProjectedPoint { at: Point::new(1.001, 2.0, z_m), normal: Vector3::y(), sd_m: 1e-4 },
            object: 0,
        };
        let surface = SurfaceMesh { vertices: [3.0, 3.002, 3.004].map(vertex).to_vec(), triangles: vec![[0, 2, 1]] };
        let (document, buffer) = parts(&SpatialMap { points, surface, ..SpatialMap::default() }.to_glb());
        let primitives = &document["meshes"][0]["primitives"];
        let bytes = |accessor: &Value, count: usize| {
            let accessor = &document["accessors"][accessor.as_u64().unwrap() as usize];
            assert_eq!(accessor["count"], count);
            let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
            let start = view["byteOffset"].as_u64().unwrap() as usize;
            buffer[start..start + view["byteLength"].as_u64().unwrap() as usize].to_vec()
        };
        let of = |name: &str| bytes(&primitives[0]["attributes"][name], 2);
        assert_eq!((&primitives[0]["mode"], &primitives[1]["mode"]), (&json!(POINTS), &json!(TRIANGLES)));
        assert_eq!(bytes(&primitives[1]["indices"], 3), [0, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0]);
        assert_eq!(bytes(&primitives[1]["attributes"]["COLOR_0"], 3)[..4], [33, 145, 140, 255]);
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
