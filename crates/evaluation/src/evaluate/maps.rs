//! Maps of recordings of several whiskers.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use files::write_atomically;
use rayon::prelude::*;
use testbed::map::{FoundObject, SceneMap, View};
use testbed::results::files::{MAP_GRID, MAP_OUTLINES, MAP_POINTS, OBJECT_OUTLINE};
use testbed::results::{GridRow, MapObjectRow, MapPointRow, MapRow, MapVertexRow, csv_bytes};

use super::array_members::ArrayMember;
use super::contours::vertex_rows;
use super::map_score::{MapScore, Truths, score_map};
use super::settings::EvaluateSettings;

/// Contribution of one whisker's estimates to a map.
pub(super) struct MapView {
    pub(super) member: ArrayMember,
    pub(super) group: String,
    pub(super) estimator: String,
    pub(super) noise: f64,
    pub(super) seed: u64,
    pub(super) view: View,
}

/// Rows of `maps.csv` and `map_objects.csv`.
#[derive(Default)]
pub(super) struct MapRows {
    pub(super) maps: Vec<MapRow>,
    pub(super) objects: Vec<MapObjectRow>,
}

/// Builds the maps of one recording, one per noise level, seed and estimator, and compares them with the truth. Those
/// of the first noise level and seed are written into the run's folder.
///
/// # Errors
/// If a file cannot be written.
pub(super) fn maps(
    folder: &Path,
    views: &[MapView],
    truths: &Truths,
    settings: &EvaluateSettings,
) -> anyhow::Result<MapRows> {
    let mut scenes: Vec<Vec<&MapView>> = Vec::new();
    let mut places = BTreeMap::new();
    for view in views {
        let key = (view.member.recording(), view.noise.to_bits(), view.seed, &view.estimator);
        let place = *places.entry(key).or_insert_with(|| {
            scenes.push(Vec::new());
            scenes.len() - 1
        });
        scenes[place].push(view);
    }
    let rows: Vec<(MapRow, Vec<MapObjectRow>)> = scenes
        .par_iter()
        .map(|scene| {
            let views: Vec<&View> = scene.iter().map(|view| &view.view).collect();
            let map = SceneMap::new(&views, &settings.map);
            let first = scene[0];
            if first.noise == settings.noise[0] && first.seed == settings.seeds[0] {
                write_map(folder, first, &map, &views)?;
            }
            let score = score_map(&map, &views, truths, first.member.array());
            Ok((map_row(first, &map, &views, &score), object_rows(first, &map, &score)))
        })
        .collect::<anyhow::Result<_>>()?;
    let (maps, objects): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
    Ok(MapRows { maps, objects: objects.concat() })
}

fn write_map(folder: &Path, first: &MapView, map: &SceneMap, views: &[&View]) -> anyhow::Result<()> {
    let array = first.member.array();
    let recording = first.member.recording();
    for (object, outline) in array.sidecar.objects.iter().zip(&array.outlines) {
        let path = OBJECT_OUTLINE.path_of(folder, &[&recording, &object.name]);
        write_atomically(&path, outline.to_csv().as_bytes())?;
    }
    let values = [recording.as_str(), first.estimator.as_str()];
    write_atomically(&MAP_POINTS.path_of(folder, &values), &csv_bytes(&point_rows(first, map, views))?)?;
    write_atomically(&MAP_OUTLINES.path_of(folder, &values), &csv_bytes(&outline_rows(map))?)?;
    write_atomically(&MAP_GRID.path_of(folder, &values), &csv_bytes(&grid_rows(map))?)?;
    Ok(())
}

fn point_rows(first: &MapView, map: &SceneMap, views: &[&View]) -> Vec<MapPointRow> {
    let whiskers = &first.member.array().sidecar.whiskers;
    let numbered = map.objects.iter().zip(1..).flat_map(|(object, number)| {
        object.points.iter().map(move |(whisker, seen)| ((*whisker, seen.point.row), number))
    });
    let numbers: BTreeMap<(usize, usize), usize> = numbered.collect();
    let points = views.iter().flat_map(|view| view.points.iter().map(move |seen| (view.whisker, seen)));
    points
        .map(|(whisker, seen)| MapPointRow {
            t_s: seen.t_s,
            whisker: whiskers[whisker].name.clone(),
            array: whiskers[whisker].array.clone(),
            object: numbers.get(&(whisker, seen.point.row)).copied(),
            x_m: seen.point.at.x,
            y_m: seen.point.at.y,
            normal_rad: seen.point.normal_rad(),
            cov_xx_m2: seen.point.covariance_m2.map(|covariance| covariance.m11),
            cov_xy_m2: seen.point.covariance_m2.map(|covariance| covariance.m12),
            cov_yy_m2: seen.point.covariance_m2.map(|covariance| covariance.m22),
        })
        .collect()
}

fn outline_rows(map: &SceneMap) -> Vec<MapVertexRow> {
    let vertices = map.objects.iter().enumerate().flat_map(|(place, object)| {
        let rows = vertex_rows(Some(&object.contour));
        rows.into_iter().map(move |vertex| MapVertexRow::new(place + 1, vertex))
    });
    vertices.collect()
}

fn grid_rows(map: &SceneMap) -> Vec<GridRow> {
    let cells = map.grid.cells();
    cells
        .map(|(at, cell)| GridRow {
            x_m: at.x(),
            y_m: at.y(),
            swept: cell.swept,
            touched: cell.touched,
            occupied: cell.occupied(),
        })
        .collect()
}

fn map_row(first: &MapView, map: &SceneMap, views: &[&View], score: &MapScore) -> MapRow {
    MapRow {
        recording: first.member.recording(),
        group: first.group.clone(),
        estimator: first.estimator.clone(),
        noise: first.noise,
        seed: first.seed,
        whiskers: views.len(),
        points: score.points,
        points_share: score.share,
        points_mean_m: score.mean_m,
        points_p95_m: score.p95_m,
        points_left_out: score.left_out,
        objects_touched: score.touched,
        objects_found: map.objects.len(),
        objects_split: score.split,
        objects_merged: score.merged,
    }
}

fn object_rows(first: &MapView, map: &SceneMap, score: &MapScore) -> Vec<MapObjectRow> {
    let array = first.member.array();
    let row = |(place, found): (usize, &FoundObject)| {
        let truth = score.objects.get(place);
        let circle = found.circle;
        let whiskers: BTreeSet<usize> = found.points.iter().map(|(whisker, _)| *whisker).collect();
        MapObjectRow {
            recording: first.member.recording(),
            estimator: first.estimator.clone(),
            noise: first.noise,
            seed: first.seed,
            object: place + 1,
            whiskers: whiskers.len(),
            points: found.points.len(),
            matched: truth.map(|truth| array.sidecar.objects[truth.object].name.clone()),
            moved_m: truth.map(|truth| array.moved_m[truth.object]),
            points_mean_m: truth.map(|truth| truth.mean_m),
            points_p95_m: truth.map(|truth| truth.p95_m),
            outline_mean_m: truth.map(|truth| truth.contour.mean_m),
            outline_p95_m: truth.map(|truth| truth.contour.p95_m),
            outline_hausdorff_m: truth.and_then(|truth| truth.contour.hausdorff_m),
            band_coverage: truth.and_then(|truth| truth.contour.band_coverage),
            center_x_m: circle.map(|circle| circle.center.x()),
            center_y_m: circle.map(|circle| circle.center.y()),
            radius_m: circle.map(|circle| circle.radius_m),
            radius_low_m: circle.map(|circle| circle.low_m),
            radius_high_m: circle.and_then(|circle| circle.high_m),
            residual_rms_m: circle.map(|circle| circle.residual_rms_m),
            radius_error_m: circle.zip(truth.and_then(|truth| truth.radius_m)).map(|(circle, m)| circle.radius_m - m),
            center_error_m: truth.and_then(|truth| truth.center_error_m),
        }
    };
    map.objects.iter().enumerate().map(row).collect()
}
