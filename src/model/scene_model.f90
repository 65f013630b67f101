!> A whole scene as the solver sees it: bodies, markers, constraints, springs, loads, and where each one's unknowns stand in the
!> state. State: q (x, y, angle, elastic coordinates, body after body), v (their rates), z (internal variables: those of second
!> order, bodies then springs, those of first order, states of controllers), z' of those of second order, then dissipated energy,
!> work, what dissipates by itself (each element that switches, each term of a material, each damped spring), and the energies that
!> sensors integrate.
module scene_model
  use kinds, only: wp
  use body, only: body_model
  use marker, only: marker_model
  use constraint, only: constraint_box
  use controller, only: controller_model
  use force_element, only: force_box
  use friction_law, only: coulomb_law
  use motion_factor, only: motion_factor_model
  implicit none (type, external)
  private

  !> A cause of dissipation that the summary lists: a term of a material in all bodies, or a spring.
  type, public :: loss_cause
    integer :: material = 0
    integer :: body = 0, layer = 0              !! of the terms of a layer
    integer :: term = 0                         !! of the material's law
    integer :: spring = 0                       !! its number among the force elements, 0: a material's term
  end type loss_cause

  !> Where power comes from or goes to: one of these. Force elements, drives and joints put it in, the last ones into their body a;
  !> the materials of a body dissipate it.
  type, public :: power_source
    integer :: element = 0                      !! number of a force element
    integer :: drive = 0                        !! number of a drive among the constraints
    integer, allocatable :: joint(:)            !! numbers of a joint and of its friction among the constraints
    integer :: body = 0                         !! number of a body
    integer :: sensor = 0                       !! the deck's number of the sensor that asks for it
  end type power_source

  !> The scene.
  type, public :: scene
    character(:), allocatable :: title
    real(wp) :: gravity(2) = 0.0_wp             !! [m/s2]
    real(wp) :: size = 1.0_wp                   !! S: largest distance between two markers of one body or of the ground [m]
    type(body_model), allocatable :: bodies(:)
    character(68), allocatable :: materials(:)  !! names, for messages
    integer, allocatable :: qo(:)               !! (nb) offset of each body's x in q, from 0
    type(marker_model), allocatable :: markers(:) !! of joints, drives, springs and loads
    type(constraint_box), allocatable :: constraints(:)   !! joints in deck order, drives, then rows that switch
    integer :: joints = 0                       !! number of joints among the constraints
    integer :: permanent = 0                    !! number of joints and drives
    integer :: permanent_rows = 0               !! rows of joints and drives, the first ones
    type(coulomb_law), allocatable :: friction(:)   !! of joints; the constraints behind the permanent ones are their rows, in this
                                                    !! order, each of one row that may hold or not
    integer :: stop_rows = 0                    !! rows of rigid stops, the last constraints, of one row each
    type(force_box), allocatable :: forces(:)   !! springs in deck order, loads, stops, then watches, which do not act
    integer :: springs = 0                      !! number of springs among the force elements
    integer :: stops = 0                        !! number of stops
    integer :: acting = 0                       !! number of springs, loads and stops
    integer :: choices = 0                      !! number of watches that are switches: their events are told
    type(motion_factor_model), allocatable :: factors(:)   !! of loads, that follow motions which the watches watch
    integer, allocatable :: corners(:)          !! of each watch of a profile's corners, the last ones: its joint or stop, its
                                                !! number among permanent constraints, then force elements
    type(controller_model), allocatable :: controllers(:)
    integer, allocatable :: switching(:)        !! force elements with discrete states: stops, then functions of motion, switches
    integer :: elements = 0                     !! all elements that switch: these force elements, then the rows that switch
    type(loss_cause), allocatable :: losses(:)  !! terms of materials, then springs
    integer :: term_losses = 0                  !! number of terms of materials among the losses
    type(power_source), allocatable :: integrated(:)   !! whose powers the state integrates for sensors
    integer, allocatable :: loaded(:)           !! markers on bodies where springs and loads act, body after body
    integer, allocatable :: loaded_first(:)     !! (nb+1) first entry of each body in it
    integer :: nq = 0                           !! coordinates
    integer :: nz = 0                           !! internal variables
    integer :: nzd = 0                          !! those of second order, which come first and have rates in the state
    integer :: rows = 0                         !! constraint rows
    integer :: quadratures = 2                  !! energies at the end of the state
    integer :: ny = 0                           !! length of the state
    real(wp), allocatable :: q0(:)              !! (nq) the deck's positions [m, rad]
    real(wp), allocatable :: start(:)           !! (nq) those from which the assembly begins: with pins in their holes [m, rad]
    real(wp), allocatable :: v0(:)              !! (nq) the deck's velocities, and from which the others begin [m/s, rad/s]
    logical, allocatable :: stated(:)           !! (nq) whether the deck states the velocity
  end type scene
end module scene_model
