//! Isolated pieces of a mesh: what noise and half-seen things leave floating beside a surface.

use super::Mesh;

impl Mesh {
    /// Drops the pieces that hang together with nothing else and whose bounding box has a diagonal below `least_m`; returns how many.
    /// Vertices must be shared where triangles meet, as those of a whole surface are.
    pub fn drop_isolated(&mut self, least_m: f64) -> usize {
        let mut parent: Vec<u32> = (0..self.positions.len() as u32).collect();
        for &[a, b, c] in &self.triangles {
            let root = find(&mut parent, a);
            for other in [b, c] {
                let other = find(&mut parent, other);
                parent[other as usize] = root;
            }
        }
        let roots: Vec<u32> = (0..parent.len() as u32).map(|i| find(&mut parent, i)).collect();
        let mut boxes = vec![[[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]]; roots.len()];
        for (p, &root) in self.positions.iter().zip(&roots) {
            let [low, high] = &mut boxes[root as usize];
            for k in 0..3 {
                (low[k], high[k]) = (low[k].min(p[k]), high[k].max(p[k]));
            }
        }
        let diagonal = |[low, high]: &[[f32; 3]; 2]| {
            (0..3).map(|k| f64::from(high[k] - low[k]).powi(2)).sum::<f64>().sqrt()
        };
        let is_kept: Vec<bool> = boxes.iter().map(|b| diagonal(b) >= least_m).collect();
        let kept = |i: usize| is_kept[roots[i] as usize];
        let dropped = (0..roots.len()).filter(|&i| roots[i] == i as u32 && !kept(i)).count();
        let mut numbers = vec![0u32; roots.len()];
        let mut count = 0;
        for i in (0..roots.len()).filter(|&i| kept(i)) {
            (numbers[i], count) = (count, count + 1);
        }
        self.triangles.retain(|t| kept(t[0] as usize));
        self.triangles.as_flattened_mut().iter_mut().for_each(|i| *i = numbers[*i as usize]);
        retain(&mut self.positions, kept);
        retain(&mut self.normals, kept);
        retain(&mut self.colours, kept);
        dropped
    }
}

/// The root of a vertex's piece; the way there is halved.
fn find(parent: &mut [u32], mut i: u32) -> u32 {
    while parent[i as usize] != i {
        let above = parent[parent[i as usize] as usize];
        parent[i as usize] = above;
        i = above;
    }
    i
}

fn retain<T>(all: &mut Vec<T>, kept: impl Fn(usize) -> bool) {
    let mut i = 0;
    all.retain(|_| {
        i += 1;
        kept(i - 1)
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip of `n` unit squares of an edge length, from x on.
    fn strip(mesh: &mut Mesh, x: f32, edge: f32, n: u32) {
        let first = mesh.positions.len() as u32;
        for i in 0..=n {
            for y in [0.0, edge] {
                mesh.positions.push([x + edge * i as f32, y, 0.0]);
                mesh.normals.push([0.0, 0.0, 1.0]);
                mesh.colours.push([i as u8; 3]);
            }
        }
        for i in 0..n {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| first + 2 * i + k);
            mesh.triangles.extend([[a, c, b], [c, d, b]]);
        }
    }

    #[test]
    fn small_pieces_are_dropped_wherever_they_are_in_the_order() {
        let mut mesh = Mesh::default();
        strip(&mut mesh, -5.0, 0.02, 2);
        strip(&mut mesh, 0.0, 0.1, 20);
        strip(&mut mesh, 5.0, 0.02, 3);
        // A vertex that no triangle uses is a piece too.
        mesh.positions.push([9.0; 3]);
        mesh.normals.push([0.0, 0.0, 1.0]);
        mesh.colours.push([9; 3]);
        let mut large = Mesh::default();
        strip(&mut large, 0.0, 0.1, 20);
        let mut all = mesh.clone();
        assert_eq!(all.drop_isolated(0.0), 0);
        assert_eq!(all, mesh);
        assert_eq!(mesh.drop_isolated(0.3), 3);
        assert_eq!(mesh, large);
        assert_eq!(mesh.drop_isolated(3.0), 1);
        assert_eq!(mesh, Mesh::default());
        assert_eq!(mesh.drop_isolated(1.0), 0);
    }
}
