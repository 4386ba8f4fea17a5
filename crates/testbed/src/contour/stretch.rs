//! Touched part of an outline.

/// Point in World.
type Point = (f64, f64);

/// Part of a closed outline (first vertex repeated at the end) from the first to the last touched point: the outline
/// without its longest untouched part. Touched points are projected on the outline; non-finite points are ignored. The
/// result is one point if only one position was touched and empty if there is none.
pub fn touched_stretch(outline: &[Point], touched: impl IntoIterator<Item = Point>) -> Vec<Point> {
    let arcs = arc_lengths(outline);
    let Some(&round) = arcs.last() else {
        return Vec::new();
    };
    let finite = touched.into_iter().filter(|(x, y)| x.is_finite() && y.is_finite());
    let mut places: Vec<f64> = finite.map(|point| arc_of_nearest(outline, &arcs, point)).collect();
    places.sort_by(f64::total_cmp);
    let (Some(&first), Some(&last)) = (places.first(), places.last()) else {
        return Vec::new();
    };
    // (length of an untouched part, start and end of the stretch that avoids it)
    let inner = places.windows(2).map(|pair| (pair[1] - pair[0], pair[1], pair[0] + round));
    let outer = (first + round - last, first, last);
    let (_, from, to) = inner.fold(outer, |longest, gap| if gap.0 > longest.0 { gap } else { longest });
    let once = &arcs[..arcs.len() - 1];
    let vertices = [0.0, round].into_iter().flat_map(|turn| once.iter().map(move |arc| arc + turn).zip(outline));
    let within = vertices.filter(|(arc, _)| from < *arc && *arc < to).map(|(_, vertex)| *vertex);
    let mut stretch = vec![point_at(outline, &arcs, from)];
    stretch.extend(within);
    if to > from {
        stretch.push(point_at(outline, &arcs, to % round));
    }
    stretch
}

/// Arc length from the first vertex to each vertex.
fn arc_lengths(outline: &[Point]) -> Vec<f64> {
    let sides = outline.windows(2).map(|side| (side[1].0 - side[0].0).hypot(side[1].1 - side[0].1));
    let first = outline.first().map(|_| 0.0);
    let sums = sides.scan(0.0, |sum, length| {
        *sum += length;
        Some(*sum)
    });
    first.into_iter().chain(sums).collect()
}

/// Arc length of the outline's point nearest to a point.
fn arc_of_nearest(outline: &[Point], arcs: &[f64], (x, y): Point) -> f64 {
    let nearest_on_side = |(side, arc): (&[Point], &f64)| {
        let (dx, dy) = (side[1].0 - side[0].0, side[1].1 - side[0].1);
        let length = dx.hypot(dy).max(f64::MIN_POSITIVE);
        let along = (((x - side[0].0) * dx + (y - side[0].1) * dy) / length).clamp(0.0, length);
        let (foot_x, foot_y) = (side[0].0 + along * dx / length, side[0].1 + along * dy / length);
        ((x - foot_x).hypot(y - foot_y), arc + along)
    };
    let nearest = outline.windows(2).zip(arcs).map(nearest_on_side).min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.map_or(0.0, |(_, arc)| arc)
}

/// Point at an arc length.
fn point_at(outline: &[Point], arcs: &[f64], arc: f64) -> Point {
    let after = arcs.partition_point(|vertex| *vertex < arc).clamp(1, arcs.len().max(2) - 1);
    let (Some(from), Some(to)) = (outline.get(after - 1), outline.get(after)) else {
        return outline[0];
    };
    let share = (arc - arcs[after - 1]) / (arcs[after] - arcs[after - 1]).max(f64::MIN_POSITIVE);
    (from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [Point; 5] = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0), (0.0, 0.0)];

    #[test]
    fn verif_the_stretch_continues_around_a_corner() {
        let touched = [(4.1, 1.0), (1.0, -0.1), (f64::NAN, 0.0), (3.0, 0.0)];
        assert_eq!(touched_stretch(&SQUARE, touched), [(1.0, 0.0), (4.0, 0.0), (4.0, 1.0)]);
    }

    #[test]
    fn verif_the_stretch_may_contain_the_first_vertex() {
        assert_eq!(touched_stretch(&SQUARE, [(1.0, 0.0), (0.0, 1.0)]), [(0.0, 1.0), (0.0, 0.0), (1.0, 0.0)]);
    }

    #[test]
    fn verif_a_touched_corner_is_one_point() {
        assert_eq!(touched_stretch(&SQUARE, [(5.0, -1.0), (4.0, 0.0)]), [(4.0, 0.0)]);
        assert!(touched_stretch(&SQUARE, []).is_empty());
        assert!(touched_stretch(&[], [(0.0, 0.0)]).is_empty());
    }
}
