//! The semantic classes of the synthetic world, with CARLA's ids (0.9.14 and later).

/// The label of a pixel that the lens does not reach.
pub const UNLABELED: u8 = 0;

macro_rules! classes {
    ($($(#[$doc:meta])* $variant:ident = $id:literal, $name:literal;)*) => {
        /// What a surface is.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u8)]
        pub enum Class { $($(#[$doc])* $variant = $id,)* }

        impl Class {
            /// Every class of the synthetic world, by id.
            pub const ALL: &[Class] = &[$(Class::$variant),*];

            /// The class's name in snake_case.
            pub const fn name(self) -> &'static str {
                match self { $(Class::$variant => $name,)* }
            }
        }
    };
}

classes! {
    /// Carriageway without its markings.
    Road = 1, "road";
    /// Pavement and kerb.
    Sidewalk = 2, "sidewalk";
    /// Houses with all that is fixed to them.
    Building = 3, "building";
    /// Free-standing walls.
    Wall = 4, "wall";
    /// See-through fences and railings.
    Fence = 5, "fence";
    /// Lamp posts, masts, bollards and the posts of signs and lights.
    Pole = 6, "pole";
    /// Traffic light heads.
    TrafficLight = 7, "traffic_light";
    /// Traffic sign plates.
    TrafficSign = 8, "traffic_sign";
    /// Trees, hedges and bushes.
    Vegetation = 9, "vegetation";
    /// Grass and soil.
    Terrain = 10, "terrain";
    /// Where a ray meets nothing.
    Sky = 11, "sky";
    /// People on foot.
    Pedestrian = 12, "pedestrian";
    /// People on two-wheelers.
    Rider = 13, "rider";
    /// Passenger cars and vans.
    Car = 14, "car";
    /// Lorries.
    Truck = 15, "truck";
    /// Buses.
    Bus = 16, "bus";
    /// Motorcycles without their riders.
    Motorcycle = 18, "motorcycle";
    /// Bicycles without their riders.
    Bicycle = 19, "bicycle";
    /// Street furniture: benches, bins, hydrants, shelters.
    Static = 20, "static";
    /// Markings painted on the carriageway.
    RoadLine = 24, "road_line";
}

impl Class {
    /// CARLA's id.
    pub const fn id(self) -> u8 {
        self as u8
    }
}
