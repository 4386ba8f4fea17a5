//! Drawn shapes as a scene of Foxglove.

use std::time::Duration;

use bag::messages::{Point, Pose as RosPose};
use foxglove::messages::{
    Color, LinePrimitive, Point3, Pose, Quaternion, SceneEntity, SceneUpdate, SpherePrimitive, Timestamp,
    TriangleListPrimitive, Vector3, line_primitive,
};
use live_ros::{Drawing, Form, Shape};

/// The shapes as entities, one each.
pub(crate) fn scene_update(drawing: &Drawing) -> SceneUpdate {
    SceneUpdate { deletions: Vec::new(), entities: drawing.shapes.iter().map(|shape| entity(drawing, shape)).collect() }
}

fn entity(drawing: &Drawing, shape: &Shape) -> SceneEntity {
    let [r, g, b, a] = shape.color.map(f64::from);
    let color = Some(Color { r, g, b, a });
    let rest = Some(Pose {
        position: Some(Vector3::default()),
        orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
    });
    let since = Duration::from_nanos(drawing.time_ns);
    let time = u32::try_from(since.as_secs()).ok().map(|sec| Timestamp::new(sec, since.subsec_nanos()));
    let lifetime = Duration::try_from_secs_f64(drawing.lifetime_s).ok().and_then(|lifetime| lifetime.try_into().ok());
    let mut entity = SceneEntity {
        timestamp: time,
        frame_id: drawing.frame.clone(),
        id: format!("{}/{}", shape.name, shape.number),
        lifetime,
        ..SceneEntity::default()
    };
    match &shape.form {
        Form::Line(points, width_m) => entity.lines.push(LinePrimitive {
            r#type: line_primitive::Type::LineStrip.into(),
            pose: rest,
            thickness: *width_m,
            points: in_foxglove(points),
            color,
            ..LinePrimitive::default()
        }),
        Form::Ellipsoid(pose, [x, y, z]) => entity.spheres.push(SpherePrimitive {
            pose: Some(placed(pose)),
            size: Some(Vector3 { x: *x, y: *y, z: *z }),
            color,
        }),
        Form::Triangles(points) => entity.triangles.push(TriangleListPrimitive {
            pose: rest,
            points: in_foxglove(points),
            color,
            ..TriangleListPrimitive::default()
        }),
    }
    entity
}

fn placed(pose: &RosPose) -> Pose {
    let RosPose { position, orientation: turned } = pose;
    Pose {
        position: Some(Vector3 { x: position.x, y: position.y, z: position.z }),
        orientation: Some(Quaternion { x: turned.x, y: turned.y, z: turned.z, w: turned.w }),
    }
}

fn in_foxglove(points: &[Point]) -> Vec<Point3> {
    points.iter().map(|point| Point3 { x: point.x, y: point.y, z: point.z }).collect()
}
