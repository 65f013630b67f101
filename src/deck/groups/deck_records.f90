!> What a deck says, as plain records: names resolved to indices, defaults filled in, every number checked for
!> its own range. No mechanics here. SI units, angles in radians. `ground` is body 0.
module deck_records
  use kinds, only: wp, ip
  use deck_origin, only: name_length, origin, named_record
  implicit none (type, external)
  private

  !> &parameter
  type, extends(named_record), public :: parameter_record
    real(wp) :: value = 0.0_wp               !! [any]
    logical :: set = .false.                 !! the command line or an &include sets it, not its own group
    logical :: used = .false.                !! an expression names it
  end type parameter_record

  !> &scene
  type, public :: scene_record
    type(origin) :: at
    character(:), allocatable :: title
    real(wp) :: gravity(2) = 0.0_wp          !! [m/s2]
  end type scene_record

  !> Viscoelastic terms of a material or a spring.
  type, public :: law_record
    real(wp), allocatable :: ghm_alpha(:)    !! [-], size 0: no such terms
    real(wp), allocatable :: ghm_zeta(:)     !! [-]
    real(wp), allocatable :: ghm_omega(:)    !! [rad/s], ghm_frequency_scale already applied
    real(wp), allocatable :: prony_alpha(:)  !! [-], size 0: no Maxwell terms
    real(wp), allocatable :: prony_tau(:)    !! [s], ghm_frequency_scale already applied
  end type law_record

  !> &material
  type, extends(named_record), public :: material_record
    real(wp) :: density = 0.0_wp             !! [kg/m3]
    real(wp) :: young = 0.0_wp               !! static modulus E_R [Pa]
    type(law_record) :: law
    real(wp) :: band(2) = 0.0_wp             !! where the modulus is known [Hz], ghm_frequency_scale already applied; 0: not stated
    real(wp) :: rayleigh_mass = 0.0_wp       !! [1/s]
    real(wp) :: rayleigh_stiffness = 0.0_wp  !! [s]
  end type material_record

  !> &section
  type, extends(named_record), public :: section_record
    real(wp) :: area = 0.0_wp                !! [m2]
    real(wp) :: inertia = 0.0_wp             !! second moment [m4]
    real(wp) :: fibre = 0.0_wp               !! distance of the outer fibre from the axis [m], 0: section without a shape
  end type section_record

  !> &body
  type, extends(named_record), public :: body_record
    character(8) :: kind = ''                !! 'rigid', 'beam', 'frame'
    real(wp) :: position(2) = 0.0_wp         !! frame origin [m]
    real(wp) :: angle = 0.0_wp               !! [rad]
    real(wp) :: velocity(2) = 0.0_wp         !! [m/s]
    real(wp) :: angular_velocity = 0.0_wp    !! [rad/s]
    logical :: velocity_stated = .false.
    logical :: angular_velocity_stated = .false.
    real(wp) :: mass = 0.0_wp                !! rigid: [kg]
    real(wp) :: inertia = 0.0_wp             !! rigid: about the mass centre [kg m2]
    real(wp) :: com(2) = 0.0_wp              !! rigid: mass centre in body axes [m]
    real(wp) :: length = 0.0_wp              !! beam: [m]
    integer :: elements = 0                  !! beam and frame: number of elements
    logical :: auto_elements = .false.       !! beam: the run finds the fewest that keep the accuracy
    integer :: mesh_level = 0                !! such a beam: elements of the longest way between two places, 0: not set
    real(wp), allocatable :: stations(:)     !! beam: where its nodes are, of its length, if not at equal distances [-]
    integer :: nodes = 0                     !! beam and frame: number of nodes; rigid: 0
    real(wp), allocatable :: node_x(:)       !! frame: [m]
    real(wp), allocatable :: node_y(:)       !! frame: [m]
    integer, allocatable :: element_nodes(:, :)   !! frame: (2, elements)
    integer, allocatable :: element_material(:)   !! index of the material of each element
    integer, allocatable :: element_section(:)    !! index of the section of each element
    logical :: flexible = .true.
    logical :: viscoelastic = .true.
    real(wp) :: modulus_at = 0.0_wp          !! not viscoelastic: frequency of the modulus that is kept [Hz]
    logical :: axial = .true.
    logical :: stiffening = .false.
    character(8) :: reference = 'pinned'     !! 'pinned', 'clamped', 'free', 'explicit' (reference_node/_dof given)
    integer, allocatable :: reference_node(:)       !! node numbers, positive (-1 already resolved)
    character(1), allocatable :: reference_dof(:)   !! 'u', 'v', 'r'
    integer :: modes = 0                     !! 0: nodal coordinates
    logical :: auto_modes = .false.          !! the run finds the fewest that keep the accuracy
    logical :: static_shapes = .false.       !! beside the modes: shapes of the markers on which joints and forces act
  end type body_record

  !> A marker on a body: a node of a beam or frame, or a point of a rigid body or of the ground.
  type, public :: marker_record
    integer :: body = 0                      !! 0: ground
    integer :: node = 0                      !! positive (-1 already resolved); 0: a point, or the body's frame itself
    real(wp) :: share = -1.0_wp              !! where the node is, of the length of a beam with elements='auto'; -1: not stated [-]
    real(wp) :: point(2) = 0.0_wp            !! in body axes [m]; 0 where a node is named
  end type marker_record

  !> &lump
  type, public :: lump_record
    type(origin) :: at
    type(marker_record) :: marker
    real(wp) :: mass = 0.0_wp                !! [kg]
    real(wp) :: inertia = 0.0_wp             !! [kg m2]
  end type lump_record

  !> &joint
  type, extends(named_record), public :: joint_record
    character(10) :: type = ''               !! 'revolute', 'weld', 'slider', 'prismatic', 'distance', 'gear'
    type(marker_record) :: a, b              !! gear: node 0 is the body's frame
    type(marker_record) :: c                 !! gear: the carrier
    real(wp) :: ratio = 1.0_wp               !! gear: turns of a for one of b [-]
    real(wp) :: direction = 0.0_wp           !! slider, prismatic [rad]
    logical :: has_length = .false.          !! distance: false: as assembled
    real(wp) :: length = 0.0_wp              !! distance [m]
    real(wp) :: friction = 0.0_wp            !! kinetic coefficient of revolute, slider, prismatic [-]
    real(wp) :: friction_static = 0.0_wp     !! static one; 0: the kinetic one [-]
    real(wp) :: pin_radius = 0.0_wp          !! revolute [m]
    real(wp) :: preload = 0.0_wp             !! part of the friction's limit without reaction [N]; revolute [N m]
    real(wp) :: pad_distance = 0.0_wp        !! prismatic [m]
  end type joint_record

  !> &drive
  type, extends(named_record), public :: drive_record
    character(10) :: type = ''               !! 'rotation', 'position'
    type(marker_record) :: a, b              !! rotation: node 0 is the body's frame
    real(wp) :: direction = 0.0_wp           !! position [rad], from the section of marker b like a slider's
    integer :: history = 0                   !! index, always given
    logical :: rate = .false.                !! the history gives the rate
    logical :: relative = .false.            !! the history is added to the assembled value
  end type drive_record

  !> &history
  type, extends(named_record), public :: history_record
    character(10) :: kind = ''               !! 'polynomial', 'sine', 'ramp', 'cycloid', 'table', 'pulse', 'sum', 'sequence'
    real(wp), allocatable :: coefficients(:) !! polynomial: c0, c1, ... [unit/s^k]
    real(wp) :: offset = 0.0_wp              !! sine [unit of what it drives]
    real(wp) :: amplitude = 0.0_wp           !! sine [unit of what it drives]
    real(wp) :: frequency = 0.0_wp           !! sine [Hz]
    real(wp) :: phase = 0.0_wp               !! sine [rad]
    real(wp) :: start_value = 0.0_wp         !! ramp, cycloid [unit of what it drives]
    real(wp) :: end_value = 0.0_wp           !! ramp, cycloid [unit of what it drives]
    real(wp) :: start = 0.0_wp               !! ramp, cycloid, pulse, sequence [s]
    real(wp) :: finish = 0.0_wp              !! ramp, cycloid, pulse [s], later than start
    real(wp), allocatable :: time(:)         !! table [s], strictly increasing
    real(wp), allocatable :: values(:)       !! table [unit of what it drives]
    character(10) :: interpolation = 'spline'   !! table: 'spline', 'pchip', 'linear'
    character(10) :: ends = 'not-a-knot'     !! table: 'not-a-knot', 'rest', 'natural'
    logical :: periodic = .false.            !! table, sequence
    character(:), allocatable :: file        !! table: where it was read from, relative to the current folder
    integer(ip) :: file_digest = 0_ip        !! table: of that file's text
    real(wp) :: value = 0.0_wp               !! pulse [unit of what it drives]
    integer, allocatable :: parts(:)         !! sum, sequence: indices of the histories
    real(wp), allocatable :: factors(:)      !! sum: of each part [-]
    real(wp), allocatable :: durations(:)    !! sequence: of each part [s]
  end type history_record

  !> A column of a sensor that is a quantity of motion, as other groups name it: `tip.x`.
  type, public :: column_record
    integer :: sensor = 0                    !! index of the sensor; 0: none is named
    character(name_length) :: suffix = ''    !! `.x`; blank: the sensor's only column
    integer :: number = 0                    !! of it among the sensor's columns of motion (`deck_columns`)
  end type column_record

  !> &force
  type, extends(named_record), public :: force_record
    character(12) :: type = ''               !! 'force', 'torque', 'torque_about'
    type(marker_record) :: marker            !! torque with node 0: on the body's frame
    real(wp) :: fx = 0.0_wp                  !! [N]
    real(wp) :: fy = 0.0_wp                  !! [N]
    character(8) :: axes = 'global'          !! 'global', 'body', 'section'
    real(wp) :: moment = 0.0_wp              !! [N m]
    real(wp) :: centre(2) = 0.0_wp           !! torque_about: global [m]
    integer :: history = 0                   !! index of its load history; 0: constant load
    type(column_record) :: argument          !! what the history is a function of, where that is not time
    integer :: controller = 0                !! index of the controller whose output is its factor, 0: none
    character(10) :: stage = 'all'           !! 'all', 'static', 'transient'
  end type force_record

  !> &spring
  type, extends(named_record), public :: spring_record
    character(10) :: type = ''               !! 'linear', 'torsional'
    type(marker_record) :: a, b              !! torsional: node 0 is the body's frame
    real(wp) :: stiffness = 0.0_wp           !! [N/m] or [N m/rad]
    integer :: characteristic = 0            !! in its place: index of a history, force over deformation; 0: none
    real(wp) :: damping = 0.0_wp             !! [N s/m] or [N m s/rad]
    logical :: has_free = .false.            !! false: free length or angle as assembled
    real(wp) :: free = 0.0_wp                !! free_length [m] or free_angle [rad]
    type(law_record) :: law
  end type spring_record

  !> &stop
  type, extends(named_record), public :: stop_record
    character(10) :: type = ''               !! 'rotation', 'position', 'clearance'
    type(marker_record) :: a, b              !! rotation: node 0 is the body's frame
    real(wp) :: direction = 0.0_wp           !! position [rad], from the section of marker b like a slider's
    real(wp) :: lower = -huge(1.0_wp)        !! limits; huge ones are not given [m] or [rad]
    real(wp) :: upper = huge(1.0_wp)         !! clearance: the gap [m] or [rad]
    real(wp) :: stiffness = 0.0_wp           !! [N/m^n] or [N m/rad^n]
    real(wp) :: exponent = 1.5_wp            !! n [-]
    real(wp) :: damping = 0.0_wp             !! [s/m] or [s/rad]
    real(wp) :: restitution = 1.0_wp         !! [-]
    logical :: rigid = .false.               !! a restitution, but no stiffness
  end type stop_record

  !> &sensor
  type, extends(named_record), public :: sensor_record
    character(20) :: quantity = ''           !! a word of the deck: 'position', ..., 'stop'
    type(marker_record) :: marker            !! body and marker, where the quantity has one (frame angles: node 0)
    logical :: relative = .false.            !! against another marker
    type(marker_record) :: other             !! that marker
    integer :: joint = 0                     !! friction, reaction, power, work: index of the joint, or
    integer :: drive = 0                     !! reaction, power, work: index of the drive
    integer :: force = 0                     !! power, work: index of the force
    integer :: spring = 0                    !! spring, power, work: index
    integer :: stop = 0                      !! stop: index
    integer :: controller = 0                !! controller: index
    integer :: element = 0                   !! internal: element number of marker%body
    integer :: index = 0                     !! coordinate: number of the elastic coordinate of marker%body, >= 1 (upper
                                             !! bound is checked where the body's coordinates are known)
    real(wp) :: accuracy = 0.0_wp            !! of its columns, of their ranges; 0: that of the transient [-]
    real(wp) :: floor = 0.0_wp               !! error that its columns may have in any case [unit of each column]
  end type sensor_record

  !> &controller
  type, extends(named_record), public :: controller_record
    type(column_record) :: argument          !! what it senses
    integer :: history = 0                   !! index of what that is to follow
    real(wp) :: kp = 0.0_wp                  !! [unit of the output over that of the quantity]
    real(wp) :: ki = 0.0_wp                  !! [the same per second]
    real(wp) :: kd = 0.0_wp                  !! [the same times a second]
    real(wp) :: filter = 0.0_wp              !! [s]
    real(wp) :: lower = -huge(1.0_wp)        !! limits; huge ones are not given [any]
    real(wp) :: upper = huge(1.0_wp)         !! [any]
    real(wp) :: windup_time = 0.0_wp         !! [s]
    real(wp) :: sample = 0.0_wp              !! [s]
    real(wp) :: delay = 0.0_wp               !! [s]
  end type controller_record

  !> &static
  type, public :: static_record
    type(origin) :: at
    logical :: present = .false.
    integer :: load_steps = 10
    real(wp) :: tolerance = 1.0e-10_wp       !! [-]
  end type static_record

  !> &modal
  type, public :: modal_record
    type(origin) :: at
    logical :: present = .false.
    integer :: modes = 10
    character(4) :: friction = 'held'        !! joints at rest: 'held' by their friction, 'free'
  end type modal_record

  !> &frequency_response
  type, public :: response_record
    type(origin) :: at
    logical :: present = .false.
    real(wp) :: from = 0.0_wp                !! [Hz]
    real(wp) :: to = 0.0_wp                  !! [Hz]
    integer :: points = 0
    character(8) :: spacing = 'log'          !! 'log', 'linear'
    integer :: force = 0                     !! index of the input force, or
    integer :: drive = 0                     !! index of the input drive
    character(4) :: friction = 'held'        !! joints at rest: 'held' by their friction, 'free'
  end type response_record

  !> &transient
  type, public :: transient_record
    type(origin) :: at
    logical :: present = .false.
    real(wp) :: t_end = 0.0_wp               !! [s]
    character(20) :: method = ''             !! 'rk4', 'dopri5', 'radau', 'generalized_alpha'
    logical :: adaptive = .false.            !! tolerance given rather than step
    real(wp) :: step = 0.0_wp                !! fixed step as written [s]
    real(wp) :: tolerance = 0.0_wp           !! adaptive [-]
    real(wp) :: first_step = 0.0_wp          !! adaptive [s], 0: chosen by the method
    real(wp) :: max_step = 0.0_wp            !! adaptive [s], 0: none
    real(wp) :: output_step = 0.0_wp         !! [s], default already filled in
    character(12) :: stabilization = 'projection'   !! 'projection', 'baumgarte', 'none'
    real(wp) :: baumgarte_alpha = 0.0_wp     !! [1/s], default already filled in
    real(wp) :: baumgarte_beta = 0.0_wp      !! [1/s], default already filled in
    real(wp) :: spectral_radius = 0.9_wp     !! [-]
    logical :: accept_unstable = .false.
    logical :: check_error = .false.         !! a second run estimates the errors of all columns
    logical :: check_reduction = .false.     !! pilots estimate what left-out modes make the columns err
    logical :: check_mesh = .false.          !! the same of the meshes of beams
    real(wp) :: accuracy = 0.0_wp            !! asked of every column, of its range; 0: method and steps are given [-]
    logical :: free_method = .false.         !! the accuracy decides on the method, too
    real(wp) :: most_seconds = huge(1.0_wp)  !! by the clock, for the search of steps that keep the accuracy [s]
    real(wp) :: checkpoint_interval = 0.0_wp !! [s of simulated time]
    real(wp) :: motion_step = 0.0_wp         !! [s]
  end type transient_record

  !> A whole deck.
  type, public :: deck
    character(:), allocatable :: path        !! as the user named it
    character(:), allocatable :: name        !! file name without folder and `.nml`
    character(:), allocatable :: text        !! the deck's text and that of its included files, for the summary
    character(:), allocatable :: flat        !! the deck as one text of numbers (`deck_flat`)
    character(:), allocatable :: settings    !! NAME=VALUE of parameters that the command line sets, a line each
    type(parameter_record), allocatable :: parameters(:)
    type(scene_record) :: scene
    type(material_record), allocatable :: materials(:)
    type(section_record), allocatable :: sections(:)
    type(body_record), allocatable :: bodies(:)
    type(lump_record), allocatable :: lumps(:)
    type(joint_record), allocatable :: joints(:)
    type(drive_record), allocatable :: drives(:)
    type(history_record), allocatable :: histories(:)
    type(force_record), allocatable :: forces(:)
    type(spring_record), allocatable :: springs(:)
    type(stop_record), allocatable :: stops(:)
    type(sensor_record), allocatable :: sensors(:)
    type(controller_record), allocatable :: controllers(:)
    type(static_record) :: static
    type(modal_record) :: modal
    type(response_record) :: response
    type(transient_record) :: transient
  end type deck
end module deck_records
