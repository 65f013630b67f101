!> What a deck says, as plain records: names resolved to indices, defaults filled in, every number checked for its own range. What
!> is here extends the records that the build makes from `keys.txt`. No mechanics. SI units, angles in radians. `ground` is body 0.
module deck_records
  use kinds, only: wp
  use deck_parts, only: column_record, law_record, marker_record
  use deck_values, only: body_values, controller_record, drive_record, force_record, history_record, joint_values, lump_record, &
    material_values, modal_record, parameter_values, periodic_values, profile_record, response_record, scene_record, &
    section_values, sensor_values, spring_record, static_record, stop_values, transient_values
  implicit none (type, external)
  private
  public :: column_record, controller_record, drive_record, force_record, history_record, law_record, lump_record, marker_record, &
    modal_record, profile_record, response_record, scene_record, spring_record, static_record

  type, extends(parameter_values), public :: parameter_record
    logical :: set = .false.                 !! the command line or an &include sets it, not its own group
    logical :: used = .false.                !! an expression names it
  end type parameter_record

  type, extends(material_values), public :: material_record
    integer :: body = 0                      !! that has the material at a temperature of its own; 0: the material of the deck
    character(68) :: label = ''              !! its name, 'm in b' of a body's own
  end type material_record

  type, extends(section_values), public :: section_record
    real(wp) :: fibre = 0.0_wp               !! distance of the outer fibre from the axis [m], 0: section without a shape
  end type section_record

  type, extends(body_values), public :: body_record
    logical :: velocity_stated = .false.
    logical :: angular_velocity_stated = .false.
    logical :: position_given = .false.
    integer :: nodes = 0                     !! beam and frame: number of nodes; rigid: 0
    integer :: own_materials = 0             !! place before its copies of all materials, at its temperature; 0: it has none
    integer, allocatable :: element_nodes(:, :)   !! frame: (2, elements)
  end type body_record

  type, extends(joint_values), public :: joint_record
    logical :: as_assembled = .false.        !! revolute: its markers stay where they are assembled, as a pin in its clearance
  end type joint_record

  type, extends(stop_values), public :: stop_record
    logical :: rigid = .false.               !! a restitution, but no stiffness
  end type stop_record

  type, extends(sensor_values), public :: sensor_record
    integer :: finer = 1                     !! elements that stand for the deck's one, from `element` on
  end type sensor_record

  type, extends(transient_values), public :: transient_record
    logical :: adaptive = .false.            !! tolerance given rather than step
    logical :: free_method = .false.         !! the accuracy decides on the method, too
    integer :: parts = 1                     !! into which fixed steps of a first pass are divided
    logical :: every_break = .false.         !! fixed steps end at breakpoints of any order
  end type transient_record

  type, extends(periodic_values), public :: periodic_record
    logical :: free_period = .false.         !! the period is an unknown
    logical :: one_period = .false.          !! the transient runs for one period, whatever that is
    logical :: own_tolerance = .false.       !! the deck gives it
  end type periodic_record

  !> A whole deck.
  type, public :: deck
    character(:), allocatable :: path        !! as the user named it
    character(:), allocatable :: name        !! file name without folder and `.nml`
    character(:), allocatable :: text        !! the deck's text and that of its included files, for the summary
    character(:), allocatable :: inputs      !! paths of all files that it reads, a null character behind each
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
    type(profile_record), allocatable :: profiles(:)
    type(force_record), allocatable :: forces(:)
    type(spring_record), allocatable :: springs(:)
    type(stop_record), allocatable :: stops(:)
    type(sensor_record), allocatable :: sensors(:)
    type(controller_record), allocatable :: controllers(:)
    type(static_record) :: static
    type(modal_record) :: modal
    type(response_record) :: response
    type(periodic_record) :: periodic
    type(transient_record) :: transient
  end type deck
end module deck_records
