//! The encoding of each kind of object.

use glam::Vec3;

use super::stored::{Reader, Stored, Writer};
use crate::data::{Atlas, Cards, Deviation, Influences, TriMesh};
use crate::data::{Candidate, Reconstruction};
use crate::refine::Refined;
use crate::simplify::{RunnerUp, Selected, Shape, Shortfall};

impl<T: Stored> Stored for Vec<T> {
    fn write(&self, writer: &mut Writer) {
        writer.number(self.len() as u64);
        self.iter().for_each(|object| object.write(writer));
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        (0..reader.number::<u64>()?).map(|_| T::read(reader)).collect()
    }
}

impl<T: Stored> Stored for Option<T> {
    fn write(&self, writer: &mut Writer) {
        writer.number(u8::from(self.is_some()));
        if let Some(object) = self {
            object.write(writer);
        }
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        if reader.flag()? { T::read(reader).map(Some) } else { Some(None) }
    }
}

impl Stored for String {
    fn write(&self, writer: &mut Writer) {
        writer.slice(self.as_bytes());
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Self::from_utf8(reader.slice()?).ok()
    }
}

impl<A: Stored, B: Stored> Stored for (A, B) {
    fn write(&self, writer: &mut Writer) {
        self.0.write(writer);
        self.1.write(writer);
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some((A::read(reader)?, B::read(reader)?))
    }
}

impl Stored for TriMesh {
    fn write(&self, writer: &mut Writer) {
        writer.slice(&self.positions);
        writer.slice(&self.triangles);
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let mesh = Self { positions: reader.slice()?, triangles: reader.slice()? };
        let vertices = mesh.positions.len();
        mesh.triangles.as_flattened().iter().all(|&v| (v as usize) < vertices).then_some(mesh)
    }
}

impl Stored for Candidate {
    fn write(&self, writer: &mut Writer) {
        match *self {
            Self::Reconstruction(Reconstruction { resolution, offset, keep }) => {
                writer.number(0u8);
                writer.number(resolution);
                writer.number([offset, keep]);
            }
            Self::Source => writer.number(1u8),
            Self::Cards => writer.number(2u8),
        }
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        match reader.number::<u8>()? {
            0 => {
                let resolution = reader.number()?;
                let [offset, keep] = reader.number()?;
                Some(Self::Reconstruction(Reconstruction { resolution, offset, keep }))
            }
            1 => Some(Self::Source),
            2 => Some(Self::Cards),
            _ => None,
        }
    }
}

impl Stored for Cards {
    fn write(&self, writer: &mut Writer) {
        let Self { group, source_group, reach } = self;
        writer.slice(group);
        writer.slice(source_group);
        writer.slice(reach);
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self { group: reader.slice()?, source_group: reader.slice()?, reach: reader.slice()? })
    }
}

impl Stored for Selected {
    fn write(&self, writer: &mut Writer) {
        let Self { best, runner_up } = self;
        best.write(writer);
        runner_up.write(writer);
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self { best: Shape::read(reader)?, runner_up: Stored::read(reader)? })
    }
}

impl Stored for RunnerUp {
    fn write(&self, writer: &mut Writer) {
        let Self { shape, relative_score } = self;
        shape.write(writer);
        writer.number(*relative_score);
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self { shape: Shape::read(reader)?, relative_score: reader.number()? })
    }
}

impl Stored for Shape {
    fn write(&self, writer: &mut Writer) {
        let Self { mesh, double_sided, candidate, render_error, deviation, self_intersecting, shortfall, cards } = self;
        mesh.write(writer);
        writer.number(u8::from(*double_sided));
        candidate.write(writer);
        writer.number(*render_error);
        deviation.write(writer);
        writer.number(*self_intersecting as u64);
        shortfall.write(writer);
        cards.write(writer);
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            mesh: TriMesh::read(reader)?,
            double_sided: reader.flag()?,
            candidate: Candidate::read(reader)?,
            render_error: reader.number()?,
            deviation: Stored::read(reader)?,
            self_intersecting: reader.number::<u64>()? as usize,
            shortfall: Stored::read(reader)?,
            cards: Stored::read(reader)?,
        })
    }
}

impl Stored for bool {
    fn write(&self, writer: &mut Writer) {
        writer.number(u8::from(*self));
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        reader.flag()
    }
}

impl Stored for Shortfall {
    fn write(&self, writer: &mut Writer) {
        writer.number(match self {
            Self::VisibleFaces => 0u8,
            Self::Components => 1,
            Self::JointPlanes => 2,
            Self::Leaves => 3,
        });
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        match reader.number::<u8>()? {
            0 => Some(Self::VisibleFaces),
            1 => Some(Self::Components),
            2 => Some(Self::JointPlanes),
            3 => Some(Self::Leaves),
            _ => None,
        }
    }
}

impl Stored for Deviation {
    fn write(&self, writer: &mut Writer) {
        let Self { mean, percentile_95, max } = *self;
        writer.number([mean, percentile_95, max]);
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let [mean, percentile_95, max] = reader.number()?;
        Some(Self { mean, percentile_95, max })
    }
}

impl Stored for Vec<Vec3> {
    fn write(&self, writer: &mut Writer) {
        writer.slice(self);
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        reader.slice()
    }
}

impl Stored for Vec<Influences> {
    fn write(&self, writer: &mut Writer) {
        writer.slice(&self.iter().map(|influences| influences.joints).collect::<Vec<_>>());
        writer.slice(&self.iter().map(|influences| influences.weights).collect::<Vec<_>>());
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let (joints, weights): (Vec<[u16; 4]>, Vec<[f32; 4]>) = (reader.slice()?, reader.slice()?);
        let pairs = || joints.iter().zip(&weights);
        (joints.len() == weights.len())
            .then(|| pairs().map(|(&joints, &weights)| Influences { joints, weights }).collect())
    }
}

impl Stored for Refined {
    fn write(&self, writer: &mut Writer) {
        let Self { psnr_initial, psnr_texture, psnr } = *self;
        writer.number([psnr_initial, psnr_texture, psnr]);
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let [psnr_initial, psnr_texture, psnr] = reader.number()?;
        Some(Self { psnr_initial, psnr_texture, psnr })
    }
}

impl Stored for Atlas {
    fn write(&self, writer: &mut Writer) {
        let Self { uvs, chart, charts, fill, stretch, worst_stretch, texels_per_unit } = self;
        writer.slice(uvs);
        writer.slice(chart);
        writer.number(*charts as u64);
        writer.number([*fill, *stretch, *worst_stretch, *texels_per_unit]);
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let (uvs, chart, charts) = (reader.slice()?, reader.slice()?, reader.number::<u64>()? as usize);
        let [fill, stretch, worst_stretch, texels_per_unit] = reader.number()?;
        Some(Self { uvs, chart, charts, fill, stretch, worst_stretch, texels_per_unit })
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::pipeline::store::{decode, encode};

    fn shapes() -> Vec<Shape> {
        let mesh = TriMesh { positions: vec![Vec3::X, Vec3::Y, Vec3::Z], triangles: vec![[0, 1, 2]] };
        let candidate = Candidate::Reconstruction(Reconstruction::thick(128));
        let cards = Cards { group: vec![3], source_group: vec![1, 2], reach: vec![0.5] };
        let deviation = Deviation { mean: 0.1, percentile_95: 0.2, max: 0.3 };
        let (double_sided, render_error, self_intersecting, cards) = (true, 0.25, 1, Some(cards));
        let shortfall = Shortfall::Leaves;
        let shape =
            Shape { mesh, double_sided, candidate, render_error, deviation, self_intersecting, shortfall, cards };
        vec![shape.clone(), Shape { candidate: Candidate::Source, cards: None, ..shape }]
    }

    #[test]
    fn objects_survive_storage() {
        let bytes = encode(&shapes());
        let read: Vec<Shape> = decode(&bytes).expect("shapes");
        assert_eq!(format!("{read:?}"), format!("{:?}", shapes()));
        for runner_up in [None, Some(RunnerUp { shape: shapes().remove(1), relative_score: 1.5 })] {
            let selected = Selected { best: shapes().remove(0), runner_up };
            let read: Selected = decode(&encode(&selected)).expect("selected");
            assert_eq!(format!("{read:?}"), format!("{selected:?}"));
        }
        let uvs = vec![[Vec2::ZERO, Vec2::X, Vec2::Y]];
        let (stretch, worst_stretch, texels_per_unit) = (1.5, 2.5, 9.0);
        let atlas = Atlas { uvs, chart: vec![0], charts: 1, fill: 0.5, stretch, worst_stretch, texels_per_unit };
        assert_eq!(decode(&encode(&atlas)), Some(atlas));
        let influences = vec![Influences { joints: [3, 1, 0, 0], weights: [0.75, 0.25, 0.0, 0.0] }];
        assert_eq!(decode(&encode(&influences)), Some(influences));
    }

    #[test]
    fn damaged_bytes_are_no_object() {
        let bytes = encode(&shapes());
        for end in 0..bytes.len() {
            assert!(decode::<Vec<Shape>>(&bytes[..end]).is_none(), "{end} bytes");
        }
        assert!(decode::<Vec<Shape>>(&[&bytes[..], b"!"].concat()).is_none());
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x80;
            // Whatever it reads as, nothing breaks and no index points outside.
            for shape in decode::<Vec<Shape>>(&damaged).into_iter().flatten() {
                shape.mesh.triangles.iter().for_each(|t| assert!(t.iter().all(|v| *v < 3)));
            }
        }
    }
}
