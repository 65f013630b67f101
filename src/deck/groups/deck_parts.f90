!> What several groups of a deck have in common.
module deck_parts
  use kinds, only: wp
  use deck_origin, only: name_length
  implicit none (type, external)
  private

  !> A marker on a body: a node of a beam or frame, or a point of a rigid body or of the ground.
  type, public :: marker_record
    integer :: body = 0                      !! 0: ground
    integer :: node = 0                      !! positive (-1 already resolved); 0: a point, or the body's frame itself
    real(wp) :: share = -1.0_wp              !! `at` as it is read, of the length of a beam; -1: not given [-]
    real(wp) :: point(2) = 0.0_wp            !! in body axes [m]; 0 where a node is named
  end type marker_record

  !> Viscoelastic terms of a material or a spring; size 0: no such terms.
  type, public :: law_record
    real(wp), allocatable :: ghm_alpha(:)    !! [-]
    real(wp), allocatable :: ghm_zeta(:)     !! [-]
    real(wp), allocatable :: ghm_omega(:)    !! [rad/s], ghm_frequency_scale already applied
    real(wp), allocatable :: prony_alpha(:)  !! [-]
    real(wp), allocatable :: prony_tau(:)    !! [s], ghm_frequency_scale already applied
  end type law_record

  !> A column of a sensor that is a quantity of motion, as other groups name it: `tip.x`.
  type, public :: column_record
    integer :: sensor = 0                    !! index of the sensor; 0: none is named
    character(name_length) :: suffix = ''    !! `.x`; blank: the sensor's only column
    integer :: number = 0                    !! of it among the sensor's columns of motion (`deck_columns`)
  end type column_record
end module deck_parts
