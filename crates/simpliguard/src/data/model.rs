//! A source model after import.

use super::{Document, Material, Rig, Surface, Texture};

/// A source model: one surface in world space, its materials and its skeleton.
#[derive(Clone, Debug)]
pub struct Model {
    /// The source's name, for messages.
    pub name: String,
    /// Every triangle of the default scene, instanced, in the rest pose.
    pub surface: Surface,
    /// Indexed by [`Surface::material`]; never empty if there are triangles.
    pub materials: Vec<Material>,
    /// Decoded images with their wrap modes, indexed by [`TextureRef::texture`](super::TextureRef::texture).
    pub textures: Vec<Texture>,
    /// The bones that move the surface; `None` for a static model.
    pub rig: Option<Rig>,
    /// The source file itself. The export writes it in front of the levels.
    pub document: Document,
    /// Data that the import left out, for the report: one line each.
    pub notes: Vec<String>,
}

impl Model {
    /// A model of that name with nothing in it.
    pub fn empty(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            surface: Surface::default(),
            materials: Vec::new(),
            textures: Vec::new(),
            rig: None,
            document: Document::default(),
            notes: Vec::new(),
        }
    }

    /// The model with another surface and other materials. Textures are shared.
    pub fn with_surface(&self, surface: Surface, materials: Vec<Material>) -> Self {
        let Self { name, surface: _, materials: _, textures, rig, document, notes } = self;
        Self {
            name: name.clone(),
            surface,
            materials,
            textures: textures.clone(),
            rig: rig.clone(),
            document: document.clone(),
            notes: notes.clone(),
        }
    }

    /// The material of triangle `t` of the surface.
    pub fn material_of(&self, t: u32) -> &Material {
        &self.materials[self.surface.material[t as usize] as usize]
    }
}
