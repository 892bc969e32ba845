"""Positions of all pieces in the assembled scenes. Lengths are in metres, z is up, a room's south-west corner is (0, 0).

A model is named CATALOGUE/NAME as in assemble.py. `turn` is an angle in degrees, counter-clockwise seen from above; at 0
the front of the piece faces south (-y). `wall` places the back of a piece against a wall, `along` metres from its west or
south end. A piece stands on the floor or at the elevation of the catalogue, unless one of these is given: `on`, the name
of another piece, whose highest point under the footprint supports it (`below` limits that height, to select an inner
board); `hang`, under the ceiling; `z`, a height.
"""


def at(name, model, x, y, turn=0, **more):
    return {"name": name, "model": model, "x": x, "y": y, "turn": turn, **more}


def wall(name, model, side, along, **more):
    return {"name": name, "model": model, "wall": side, "along": along, **more}


def opening(side, middle, width, bottom, height, thick=0.3):
    span = {"from": middle - width / 2, "to": middle + width / 2}
    return {"wall": side, **span, "bottom": bottom, "top": bottom + height, "thick": thick}


def panel(name, x, y, z, width, depth, ke):
    return {"name": name, "x": x, "y": y, "z": z, "width": width, "depth": depth, "ke": (ke, ke, ke)}


# --- living room ------------------------------------------------------------------------------------------------------

LIVINGROOM = {
    "room": {
        "size": (7.2, 5.2, 2.7),
        "openings": [
            opening("S", 1.9, 1.10, 0.85, 1.30, thick=0.32),
            opening("S", 5.2, 1.10, 0.85, 1.30, thick=0.32),
            opening("E", 4.55, 0.87, 0.0, 2.10, thick=0.14),
        ],
    },
    "lights": [
        panel("ceiling_panel_1", 1.75, 1.15, 2.67, 1.2, 0.3, 25),
        panel("ceiling_panel_2", 1.75, 4.05, 2.67, 1.2, 0.3, 25),
        panel("ceiling_panel_3", 5.0, 1.5, 2.67, 1.2, 0.3, 25),
        panel("ceiling_panel_4", 5.0, 3.7, 2.67, 1.2, 0.3, 25),
    ],
    "pieces": [
        at("window_left", "Scopia/window_2x1_medium_with_large_pane", 1.9, -0.16, 180),
        at("window_right", "Scopia/window_2x1_medium_with_large_pane", 5.2, -0.16, 180),
        at("door", "Scopia/puerta", 7.27, 4.55, -90),
        wall("radiator_left", "CCBY/modernRadiator", "S", 1.9),
        wall("radiator_right", "CC0/radiator1", "S", 5.2),
        # seats
        at("rug", "Kator/oriental-rug", 4.98, 2.6),
        at("sofa", "Scopia/leather_sofa", 3.5, 2.6, 90),
        at("coffee_table", "Scopia/saloon_table", 4.95, 2.6, 90, on="rug"),
        at("armchair_red", "CC0/winchesterArmchair", 5.2, 4.45, 0),
        at("armchair_yellow", "Scopia/armchair2", 5.0, 0.75, 160),
        at("side_table_1", "CCBY/bedsideTable", 3.5, 3.95, 90),
        at("side_table_2", "CCBY/bedsideTable", 3.5, 1.25, 90),
        at("lamp_1", "CCBY/lamp", 3.5, 3.95, on="side_table_1"),
        at("lamp_2", "Scopia/little_lamp2", 3.5, 1.25, on="side_table_2"),
        at("floor_lamp", "Scopia/living_lamp", 6.3, 1.25, 150),
        wall("tv_stand", "CCBY/tvStand", "E", 2.6),
        at("tv", "CC0/led_tv", 6.95, 2.45, -90, on="tv_stand", scale=1.2),
        at("game_console", "Scopia/playstation4", 6.95, 3.09, -90, on="tv_stand"),
        at("magazine", "Kator/newspaper", 4.93, 2.2, 75, on="coffee_table"),
        at("ivy", "CC0/augalas", 4.93, 2.62, 90, on="coffee_table", scale=0.8),
        at("remote_control", "Scopia/tv-remote-control", 5.02, 3.05, 40, on="coffee_table"),
        at("coffee_cup", "CC0/caffe_final", 4.85, 3.1, 0, on="coffee_table"),
        # dining table
        at("dining_table", "CC0/table", 1.75, 2.6, 90),
        at("dining_chair_1", "CC0/thonet", 2.48, 1.85, -90),
        at("dining_chair_2", "CC0/thonet", 2.48, 2.6, -84),
        at("dining_chair_3", "CC0/thonet", 2.48, 3.35, -90),
        at("dining_chair_4", "CC0/thonet", 1.02, 1.85, 90),
        at("dining_chair_5", "CC0/thonet", 1.02, 2.6, 97),
        at("dining_chair_6", "CC0/thonet", 1.02, 3.35, 90),
        at("place_1", "Scopia/ensemble-assiette-couteau-fourchette-cuillere-verre", 2.02, 1.85, 90, on="dining_table"),
        at("place_2", "Scopia/ensemble-assiette-couteau-fourchette-cuillere-verre", 2.02, 2.6, 90, on="dining_table"),
        at("place_3", "Scopia/ensemble-assiette-couteau-fourchette-cuillere-verre", 2.02, 3.35, 90, on="dining_table"),
        at("place_4", "Scopia/ensemble-assiette-couteau-fourchette-cuillere-verre", 1.48, 1.85, -90, on="dining_table"),
        at("place_5", "Scopia/ensemble-assiette-couteau-fourchette-cuillere-verre", 1.48, 2.6, -90, on="dining_table"),
        at("place_6", "Scopia/ensemble-assiette-couteau-fourchette-cuillere-verre", 1.48, 3.35, -90, on="dining_table"),
        at("salad_bowl", "Scopia/bowlWithSalad", 1.75, 2.98, 20, on="dining_table"),
        at("wine_bottle", "Scopia/wine_bottle", 1.75, 2.25, 0, on="dining_table"),
        at("chandelier", "CC0/lamp2", 1.75, 2.6, 0, hang=True),
        # along the walls
        wall("sideboard", "CCBY/dresserWithDrawers", "W", 2.6),
        at("vase", "Scopia/vase2", 0.28, 2.05, 0, on="sideboard"),
        at("stereo", "Scopia/mini_stereo", 0.28, 2.75, 90, on="sideboard"),
        at("deer", "CC0/deer", 0.3, 3.25, 60, on="sideboard"),
        wall("bookcase_1", "CCBY/bookcase", "N", 0.95),
        wall("bookcase_2", "Kator/full-bookcase", "N", 2.27),
        wall("bookcase_3", "CCBY/bookcase", "N", 3.6),
        # plants
        at("olive_tree", "CC0/decorativePlant", 6.65, 0.5, 30),
        at("yucca", "CCBY/yuccaPlant", 0.62, 0.66, 0),
        at("flower_pot", "CC0/littlePlant", 1.0, 5.0, 0, on="bookcase_1"),
        at("bonsai", "Scopia/bonsai-tree", 3.4, 5.0, 40, on="bookcase_3", scale=0.75),
    ],
    "books": [
        {"name": "books_1", "on": "bookcase_1", "turn": 0, "seed": 1},
        {"name": "books_3", "on": "bookcase_3", "turn": 0, "seed": 2},
    ],
}

# --- kitchen ----------------------------------------------------------------------------------------------------------

KITCHEN = {
    "room": {
        "size": (4.46, 3.8, 2.6),
        "floor_kd": (0.50, 0.48, 0.45),
        "wall_kd": (0.75, 0.74, 0.68),
        "openings": [opening("E", 1.3, 1.10, 0.85, 1.30, thick=0.32), opening("W", 0.75, 0.96, 0.0, 2.10, thick=0.18)],
    },
    "lights": [
        panel("ceiling_panel_1", 1.2, 2.2, 2.57, 1.2, 0.3, 25),
        panel("ceiling_panel_2", 3.2, 2.2, 2.57, 1.2, 0.3, 25),
        panel("ceiling_panel_3", 2.2, 0.9, 2.57, 1.2, 0.3, 25),
    ],
    "pieces": [
        at("window", "Scopia/window_2x1_medium_with_large_pane", 4.62, 1.3, -90),
        at("door", "Scopia/door", -0.09, 0.75, 90),
        # the row on the north wall
        wall("refrigerator", "CC0/refrigerator", "N", 0.47),
        wall("drawers", "CCBY/kitchenDrawersCabinet", "N", 1.18),
        wall("sink", "CCBY/kitchenSink", "N", 1.89),
        wall("lower_cabinet_1", "CCBY/kitchenSmallLowerCabinet", "N", 2.6215),
        wall("stove", "CCBY/largeStove", "N", 3.386),
        wall("lower_cabinet_2", "CCBY/kitchenSmallLowerCabinet", "N", 4.15),
        wall("upper_cabinet_1", "CCBY/kitchenUpperCabinet", "N", 1.53),
        wall("upper_cabinet_2", "CCBY/kitchenGlassDoorCabinet", "N", 2.2455),
        wall("upper_cabinet_3", "CCBY/kitchenSmallUpperCabinet", "N", 2.582),
        wall("upper_cabinet_4", "CCBY/kitchenGlassDoorCabinet", "N", 4.28),
        wall("hood", "CCBY/hood", "N", 3.386),
        wall("kitchen_tools", "CCBY/kitchenTools", "N", 2.2, z=1.05),
        at("toaster", "Scopia/toaster", 1.18, 3.42, 0, on="drawers"),
        at("coffee_maker", "Kator/coffee-maker", 2.52, 3.5, 0, on="lower_cabinet_1"),
        at("oil", "Kator/oil-servers", 2.75, 3.55, 0, on="lower_cabinet_1"),
        at("microwave", "CCBY/microwave", 4.16, 3.55, 0, on="lower_cabinet_2"),
        at("kettle", "CCBY/boiler", 3.12, 3.35, 30, on="stove"),
        at("pan", "CCBY/largePan", 3.64, 3.48, 0, on="stove"),
        # the island
        at("island", "CCBY/kitchenIsland", 3.1, 1.75, 0),
        at("mixer", "CC0/kitchenaid", 3.4, 1.8, -20, on="island"),
        at("chopping_board", "CCBY/choppingBoard", 2.88, 1.62, 0, on="island"),
        at("bread", "CC0/bread", 2.88, 1.62, 15, on="chopping_board"),
        at("knife_block", "Scopia/kitchenKnifeStandSet", 2.74, 1.93, 0, on="island"),
        at("utensils", "CCBY/utensilsPot", 3.05, 1.95, 0, on="island"),
        at("bar_stool_1", "CC0/stool2", 2.9, 1.15, 0),
        at("bar_stool_2", "CC0/stool2", 3.35, 1.18, 0),
        # the table
        at("table", "Scopia/white_kitchen_table", 1.35, 1.35, 0),
        at("chair_1", "Scopia/white_kitchen_chair", 1.08, 1.86, 0),
        at("chair_2", "Scopia/white_kitchen_chair", 1.62, 1.88, -6),
        at("chair_3", "Scopia/white_kitchen_chair", 1.08, 0.84, 180),
        at("chair_4", "Scopia/white_kitchen_chair", 1.62, 0.82, 174),
        at("place_1", "Kator/plate-and-ustensils", 1.08, 1.53, 180, on="table"),
        at("place_2", "Kator/plate-and-ustensils", 1.62, 1.53, 180, on="table"),
        at("place_3", "Kator/plate-and-ustensils", 1.08, 1.17, 0, on="table"),
        at("place_4", "Kator/plate-and-ustensils", 1.62, 1.17, 0, on="table"),
        at("salad", "Scopia/bowlWithSalad", 1.35, 1.42, 0, on="table"),
        at("sugar_pot", "Scopia/pottery", 1.35, 1.15, 40, on="table"),
        # other pieces
        wall("washing_machine", "Scopia/clothes_washing_machine", "S", 3.9),
        at("shopping_basket", "Scopia/shopping-basket", 3.9, 0.31, 10, on="washing_machine", scale=0.7),
        wall("shelf", "CC0/verticalShelves", "S", 2.6),
        at("apples", "Scopia/apples", 2.6, 0.2, 0, on="shelf"),
        at("waste_bin", "Kator/bullet-trash-can", 3.35, 0.25, 0),
    ],
}

# --- office -----------------------------------------------------------------------------------------------------------


def desk_pair(number, x, y):
    """Two desks that face each other, with the objects on them; desk b is the northern one."""
    south, north = f"desk_{number}a", f"desk_{number}b"
    return [
        at(south, "Scopia/wooden_office_pear_table_rect", x, y - 0.41, 0),
        at(north, "Scopia/wooden_office_pear_table_rect", x, y + 0.41, 180),
        at(f"office_chair_{number}a", "Scopia/office_chair", x - 0.1, y - 1.1, 160 + 7 * number),
        at(f"office_chair_{number}b", "Scopia/office_chair", x + 0.15, y + 1.12, -15 * number),
        at(f"computer_{number}a", "Scopia/apple_pc", x, y - 0.35, 0, on=south),
        at(f"computer_{number}b", "Scopia/apple_pc", x, y + 0.35, 180, on=north),
        at(f"phone_{number}a", "Scopia/phone", x - 0.6, y - 0.5, 10, on=south),
        at(f"phone_{number}b", "Scopia/phone", x + 0.6, y + 0.5, 170, on=north),
        at(f"letter_tray_{number}a", "Scopia/bandeja", x + 0.55, y - 0.4, 0, on=south),
        at(f"letter_tray_{number}b", "Scopia/bandeja", x - 0.55, y + 0.4, 180, on=north),
        at(f"waste_paper_{number}", "CC0/dustbin", x + 1.0, y - 0.5, 0),
    ]


OFFICE = {
    "room": {
        "size": (9.0, 7.0, 2.8),
        "floor_kd": (0.30, 0.32, 0.36),
        "wall_kd": (0.76, 0.76, 0.74),
        "openings": [
            opening("S", 2.5, 1.88, 0.11, 2.18, thick=0.32),
            opening("S", 6.5, 1.88, 0.11, 2.18, thick=0.32),
            opening("E", 5.9, 0.96, 0.0, 2.10, thick=0.18),
        ],
    },
    "lights": [
        panel("ceiling_panel_1", 2.4, 2.0, 2.77, 1.2, 0.6, 15),
        panel("ceiling_panel_2", 6.4, 2.0, 2.77, 1.2, 0.6, 15),
        panel("ceiling_panel_3", 2.4, 5.0, 2.77, 1.2, 0.6, 15),
        panel("ceiling_panel_4", 6.4, 5.0, 2.77, 1.2, 0.6, 15),
    ],
    "pieces": [
        at("window_1", "Scopia/window_3x1", 2.5, -0.16, 180),
        at("window_2", "Scopia/window_3x1", 6.5, -0.16, 180),
        at("door", "Scopia/door", 9.09, 5.9, -90),
        *desk_pair(1, 2.2, 2.2),
        *desk_pair(2, 4.9, 2.2),
        *desk_pair(3, 7.4, 2.2),
        at("pen_box", "Scopia/penbox", 2.75, 2.05, 0, on="desk_1a"),
        at("desk_lamp", "Scopia/desk_lamp1", 6.74, 2.05, 30, on="desk_3a"),
        # meeting table
        at("meeting_table", "Scopia/round-table", 6.9, 5.3, 0),
        at("meeting_chair_1", "Scopia/plastic_chair", 7.72, 5.3, -90),
        at("meeting_chair_2", "Scopia/plastic_chair", 6.9, 6.12, 0),
        at("meeting_chair_3", "Scopia/plastic_chair", 6.08, 5.3, 90),
        at("meeting_chair_4", "Scopia/plastic_chair", 6.9, 4.48, 180),
        at("laptop", "CCBY/laptop", 6.85, 5.12, 200, on="meeting_table"),
        at("cup_1", "Kator/coffee-mug", 7.15, 5.2, 30, on="meeting_table"),
        at("cup_2", "Kator/coffee-mug", 6.75, 5.62, 200, on="meeting_table"),
        at("white_board", "CC0/whiteBoard", 4.9, 6.5, 0),
        # along the walls
        wall("low_cupboard", "Scopia/office_furniture1", "W", 2.9),
        wall("lockers", "Scopia/office_box", "W", 5.75),
        wall("bookcase_1", "CCBY/bookcase", "N", 1.5),
        wall("bookcase_2", "CCBY/bookcase", "N", 3.3),
        wall("filing_cabinet_1", "Kator/filing-cabinet", "E", 3.6),
        wall("filing_cabinet_2", "Kator/filing-cabinet", "E", 4.0),
        wall("filing_cabinet_3", "Kator/filing-cabinet", "E", 4.4),
        at("printer", "Scopia/inkjet_and_scanner_printer", 8.73, 3.8, -90, on="filing_cabinet_1"),
        wall("water_cooler", "Scopia/water_cooler", "N", 8.4),
        at("palm_lily", "CC0/plant", 0.5, 0.5, 0),
        at("green_plant", "CCBY/mediumIndoorPlant", 8.5, 0.5, 0),
    ],
    "books": [
        {"name": "books_1", "on": "bookcase_1", "turn": 0, "seed": 11},
        {"name": "books_2", "on": "bookcase_2", "turn": 0, "seed": 12},
    ],
}

# --- park -------------------------------------------------------------------------------------------------------------


def row(name, model, places, turn=0, scale=1.0, step=137):
    """Several pieces of one model with different angles and slightly different sizes."""
    return [
        at(f"{name}_{k}", model, x, y, turn=(turn + step * k) % 360, scale=scale * (1 + 0.12 * ((k * 5) % 3 - 1)))
        for k, (x, y) in enumerate(places, 1)
    ]


PARK = {
    "room": {"size": (36.0, 36.0, 0.0), "outdoors": True},
    "ground": [
        {"name": "lawn_south", "box": (0, 0, 36, 16.5), "kd": (0.16, 0.24, 0.08)},
        {"name": "path", "box": (0, 16.5, 36, 19.5), "kd": (0.42, 0.38, 0.32)},
        {"name": "lawn_north", "box": (0, 19.5, 36, 36), "kd": (0.16, 0.24, 0.08)},
    ],
    "lights": [{"name": "sky", "x": 18, "y": 18, "z": 60.0, "width": 44, "depth": 44, "ke": (3.0, 3.0, 3.0), "thick": 0}],
    "pieces": [
        at("copper_beech", "Scopia/copperBeech", 6.5, 28.5, 20),
        at("sycamore", "Scopia/sycamoreMaple", 20.0, 29.0, 75),
        at("japanese_maple", "Scopia/japaneseMaple", 30.0, 28.0, 140),
        at("acacia", "Scopia/acacia", 6.5, 7.0, 60),
        at("peach_blossom", "Scopia/peachBlossom", 15.5, 8.5, 10),
        at("poplar_1", "Scopia/poplar", 12.8, 31.5, 0),
        at("poplar_2", "Scopia/poplar", 25.6, 22.3, 200, scale=0.85),
        at("ficus", "Scopia/ficusTree", 23.0, 10.5, 33, scale=1.2),
        at("pine_1", "Scopia/pine", 31.0, 5.0, 0, scale=1.3),
        at("pine_2", "Scopia/pine", 27.5, 9.5, 120),
        at("palm", "Scopia/palm", 31.5, 13.0, 0, scale=0.7),
        *row("cypress", "Scopia/cypress", [(1.5, 21.5), (4.0, 21.5), (32.5, 21.5), (34.8, 21.5)]),
        *row("bush", "Scopia/bush", [(11.5, 3.5), (20.5, 4.0), (13.0, 22.0)]),
        *row("hedge", "Scopia/hedge", [(1.6 + 1.55 * k, 34.8) for k in range(4)], scale=0.95, step=180),
        at("bamboo", "Scopia/bamboo", 34.0, 33.5, 0),
        at("fountain", "CCBY/fountain", 18.0, 18.0, 0),
        at("bench_1", "Kator/concrete-bench", 8.0, 20.0, 0),
        at("bench_2", "Kator/concrete-bench", 28.0, 20.0, 0),
        at("bench_3", "Scopia/wood_bank", 9.0, 16.0, 180),
        at("bench_4", "Scopia/wood_bank", 26.0, 16.0, 180),
        at("lamp_post_1", "Scopia/farola1", 4.0, 16.2),
        at("lamp_post_2", "Scopia/farola1", 13.0, 16.2),
        at("lamp_post_3", "Scopia/farola1", 22.0, 19.8),
        at("lamp_post_4", "Scopia/farola1", 31.0, 19.8),
        at("waste_basket_1", "Kator/park-trashcan", 10.3, 20.1),
        at("waste_basket_2", "Kator/park-trashcan", 28.0, 15.9),
        at("flower_box_1", "CC0/flowerBox", 18.0, 15.9, 180, scale=2.0),
        at("flower_box_2", "CC0/plantie", 18.0, 20.1, 0, scale=1.8),
        at("swing", "CC0/childSwing", 21.0, 14.0, 30),
        at("slide", "Scopia/parque", 7.5, 12.9, 10),
        at("boulder_1", "CC0/rock1", 14.5, 13.0, 0, scale=1.6),
        at("boulder_2", "CC0/rock3", 15.4, 13.4, 70, scale=1.4),
    ],
}

SCENES = {"livingroom": LIVINGROOM, "kitchen": KITCHEN, "office": OFFICE, "park": PARK}

# The open court of Sponza (y up): x0, z0, x1, z1 of the panel, which faces down.
SPONZA_PANEL = {"box": (-12.0, -3.5, 12.0, 3.5), "height": 18.0, "ke": (12.0, 12.0, 12.0)}
