//! Surface of a map as triangle mesh.

use testbed::space::surface::SurfaceMesh;

use crate::properties::one_error;
use crate::scratch;

const FILE: &str = "untrusted.surface.ply";

pub(super) fn run(bytes: &[u8]) {
    let read = |bytes: &[u8]| one_error(SurfaceMesh::read_ply(&scratch::file(FILE, bytes)), FILE);
    let Some(mesh) = read(bytes) else { return };
    let vertices = mesh.vertices.len();
    assert!(mesh.triangles.iter().flatten().all(|corner| (*corner as usize) < vertices));
    assert!(mesh.area_m2().is_finite() && mesh.certain_area_m2().is_finite());
    let written = |mesh: &SurfaceMesh| read(mesh.to_ply().as_bytes()).expect("written data can be read");
    // The colour of a vertex is that of its standard deviation before rounding.
    let rounded = written(&mesh);
    let again = written(&rounded);
    assert_eq!(again.to_ply(), rounded.to_ply());
    assert_eq!((again.vertices.len(), &again.triangles), (vertices, &mesh.triangles));
}
