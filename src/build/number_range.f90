!> Refuses decks whose numbers double precision cannot carry, as faults of the deck and before anything is computed:
!> - masses, stiffness or squared frequencies so large or small that products of several overflow
!> - masses of one body so uneven that some are lost in rounding
!> - markers so far from a body that rounding of its angle moves them.
module number_range
  use kinds, only: wp
  use body, only: body_model
  use deck_numbers, only: decades
  use deck_origin, only: origin
  use deck_records, only: deck, body_record
  use errors, only: fault_list
  use build_law, only: law_of
  use scene_model, only: scene
  use text, only: to_text
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: check_laws, check_values, check_distances

  real(wp), parameter, public :: lost = 64*epsilon(1.0_wp)   !! a mass or length beside a larger one: fewer than two digits stay [-]
  real(wp), parameter :: farthest = 1.0e10_wp   !! a marker from a mass centre, the end of an element, in radii of gyration [-]

contains

  !> Reports laws of materials and springs whose terms are out of range.
  subroutine check_laws(d, faults)
    type(deck), intent(in) :: d
    type(fault_list), intent(inout) :: faults
    integer :: k
    do k = 1, size(d%materials)
      call check_law(d%materials(k)%at, law_of(d%materials(k)%law), faults)
    end do
    do k = 1, size(d%springs)
      call check_law(d%springs(k)%at, law_of(d%springs(k)%law), faults)
    end do
  end subroutine check_laws

  !> Reports the first term of a law that is out of range.
  subroutine check_law(at, law, faults)
    type(origin), intent(in) :: at
    type(viscoelastic_terms), intent(in) :: law
    type(fault_list), intent(inout) :: faults
    integer :: k
    do k = 1, size(law%alpha)
      if (out_of_range(at, 'weight of a '//trim(law%words(k))//' term', law%alpha(k), '', faults)) return
      if (out_of_range(at, 'viscosity of a '//trim(law%words(k))//' term', law%viscosity(k), 's', faults)) return
      if (out_of_range(at, 'inertia of a '//trim(law%words(k))//' term', law%inertia(k), 's2', faults)) return
    end do
  end subroutine check_law

  !> Reports the first value of a body that is out of range. Each value is computed from values that were checked before.
  subroutine check_values(d, r, b, faults)
    type(deck), intent(in) :: d
    type(body_record), intent(in) :: r
    type(body_model), intent(in) :: b
    type(fault_list), intent(inout) :: faults
    real(wp) :: instantaneous                        ! instantaneous over static stiffness [-]
    integer :: e
    if (value_refused('mass', b%mass, 'kg')) return
    if (value_refused('moment of inertia about its origin', b%i11, 'kg m2')) return
    if (r%kind == 'rigid' .or. .not. r%flexible) return
    if (minval(b%elements%mass) < lost*b%mass) then
      call r%at%blame(faults, 'its masses are too uneven for double precision: an element of '// &
                  to_text(minval(b%elements%mass))//' kg in a body of '//to_text(b%mass)//' kg; expected at least 1e-14 of it')
      return
    end if
    do e = 1, b%ne
      associate (g => b%elements(e))
        instantaneous = maxval([1.0_wp, over_static(b%layers%kinds(b%layers%kind(e))%material)])
        if (value_refused('mass of an element', g%mass, 'kg')) return
        if (value_refused('rotary inertia of an element', g%mass*g%length**2, 'kg m2')) return
        if (value_refused('bending stiffness of an element', g%ei_l/g%length**2, 'N/m')) return
        if (value_refused('squared bending frequency of an element', g%ei_l/g%length**2/g%mass*instantaneous, 'rad2/s2')) return
        if (.not. r%axial) cycle
        if (value_refused('axial stiffness of an element', g%ea_l, 'N/m')) return
        if (value_refused('squared axial frequency of an element', g%ea_l/g%mass*instantaneous, 'rad2/s2')) return
        if (g%ei_l >= g%ea_l*(g%length/farthest)**2) cycle
        call r%at%blame(faults, 'an element of '//to_text(g%length)//' m is too slender for double precision: its bending is '// &
                    'lost beside its stretch; expected at most 1e10 radii of gyration of its section (or axial=.false.)')
        return
      end associate
    end do
  contains
    !> Instantaneous over static modulus of a material, 0: no terms.
    elemental real(wp) function over_static(material)   ! [-]
      integer, intent(in) :: material
      type(viscoelastic_terms) :: law
      over_static = 1.0_wp
      if (material == 0) return
      law = law_of(d%materials(material)%law)
      over_static = 1.0_wp + sum(law%alpha)
    end function over_static

    !> Whether a value of the body is out of range.
    logical function value_refused(what, x, unit)
      character(*), intent(in) :: what, unit
      real(wp), intent(in) :: x               !! not negative [unit]
      value_refused = out_of_range(r%at, what, x, unit, faults)
    end function value_refused
  end subroutine check_values

  !> Whether a value is out of range, which is reported.
  logical function out_of_range(at, what, x, unit, faults)
    type(origin), intent(in) :: at
    character(*), intent(in) :: what, unit
    real(wp), intent(in) :: x                 !! not negative [unit]
    type(fault_list), intent(inout) :: faults
    out_of_range = .not. (x <= 10.0_wp**decades .and. (x >= 10.0_wp**(-decades) .or. abs(x) <= 0.0_wp))   ! as a deck's numbers
    if (out_of_range) call at%blame(faults, 'the '//what//' would be '//trim(to_text(x)//' '//unit)// &
                                ', too far from 1 to compute with in double precision; expected 1e-60 to 1e60 (check units)')
  end function out_of_range

  !> Reports what rounding of positions and angles would hide:
  !> - inertias too small for the scene
  !> - forces whose accelerations are out of range
  !> - markers that rounding of an angle moves too far.
  subroutine check_distances(d, s, faults)
    type(deck), intent(in) :: d
    type(scene), intent(in) :: s
    type(fault_list), intent(inout) :: faults
    real(wp) :: distance, radius              ! [m]
    integer :: k
    do k = 1, size(s%bodies)
      radius = sqrt(s%bodies(k)%i11/s%bodies(k)%mass)
      if (radius < lost*s%size) call d%bodies(k)%at%blame(faults, 'its radius of gyration, '//to_text(radius)// &
        ' m, is lost in rounding beside the size of the scene, '//to_text(s%size)//' m; expected at least 1e-14 of it')
    end do
    do k = 1, size(d%forces)
      associate (f => d%forces(k))
        if (out_of_range(f%at, 'acceleration of its body', hypot(f%fx, f%fy)/s%bodies(f%marker%body)%mass, &
                   'm/s2', faults)) return
      end associate
    end do
    do k = 1, size(s%markers)
      if (s%markers(k)%body == 0) cycle
      associate (b => s%bodies(s%markers(k)%body))
        distance = norm2(s%markers(k)%x - b%i1/b%mass)
        radius = sqrt(max(b%i11/b%mass - sum((b%i1/b%mass)**2), 0.0_wp))
        if (.not. distance > farthest*radius) cycle
        call d%bodies(s%markers(k)%body)%at%blame(faults, 'a joint or force acts '//to_text(distance)//' m from its mass '// &
                    'centre, too far for double precision beside a radius of gyration of '//to_text(radius)// &
                    ' m; expected at most 1e10 times as far')
      end associate
    end do
  end subroutine check_distances
end module number_range
