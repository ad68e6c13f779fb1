//! The semantic classes of the synthetic world, with CARLA's ids (0.9.14 and later).

/// The label of a pixel that the lens does not reach.
pub const UNLABELED: u8 = 0;

macro_rules! classes {
    ($($(#[$doc:meta])* $variant:ident = $id:literal, $name:literal;)*) => {
        /// A semantic class; its discriminant is its id.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u8)]
        pub enum Class { $($(#[$doc])* $variant = $id,)* }

        impl Class {
            /// Every class of the synthetic world, by id.
            pub const ALL: &[Class] = &[$(Class::$variant),*];

            /// Returns the name of the class.
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
    /// Houses with everything attached to them.
    Building = 3, "building";
    /// Free-standing walls.
    Wall = 4, "wall";
    /// See-through fences and railings.
    Fence = 5, "fence";
    /// Lamp posts, masts, bollards and the posts of signs and lights.
    Pole = 6, "pole";
    /// Traffic lights without their posts.
    TrafficLight = 7, "traffic_light";
    /// Traffic signs without their posts.
    TrafficSign = 8, "traffic_sign";
    /// Trees, hedges and bushes.
    Vegetation = 9, "vegetation";
    /// Grass and soil.
    Terrain = 10, "terrain";
    /// Nothing within the camera's range.
    Sky = 11, "sky";
    /// People on foot.
    Pedestrian = 12, "pedestrian";
    /// People on bicycles and motorcycles.
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
    /// Painted lines on the carriageway.
    RoadLine = 24, "road_line";
}

impl Class {
    /// Returns the id of the class.
    pub const fn id(self) -> u8 {
        self as u8
    }
}
