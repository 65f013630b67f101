!> The cause of the bound of an explicit step: body and strain of a fast mode, or material or spring of a viscoelastic pole.
module bound_causes
  use kinds, only: wp
  use linear_matrices, only: linear_segment
  use mechanism, only: mechanism_model
  use spectrum, only: fast_mode
  use text, only: either, to_text
  implicit none (type, external)
  private
  public :: mode_cause, pole_cause, name_damping

  real(wp), parameter :: takes_part = 1.0e-3_wp   !! share of a mode's strain energy from which a body is named [-]

  !> Cause of an eigenvalue.
  type, public :: bound_cause
    character(:), allocatable :: what              !! in words
    integer :: body = 0                      !! body that carries the mode or has the material, 0: none
    integer :: segment = 0                   !! segment of the internal variable, 0: a mode
    logical :: rayleigh = .false.            !! Rayleigh damping of the body sets it
    integer :: material = 0                  !! material of that segment, 0: none, or a spring's terms
  end type bound_cause

  character(18), parameter :: strains(3) = [character(18) :: 'an axial mode', 'a bending mode', 'slip of the layers']

contains

  !> Which body carries a mode, and whether its strain is axial, in bending or of layers that slip.
  subroutine mode_cause(m, f, cause)
    type(mechanism_model), intent(in) :: m
    type(fast_mode), intent(in) :: f
    type(bound_cause), intent(out) :: cause
    real(wp) :: best, strained, parts(3)      ! [1/s2]
    integer :: b, i, largest
    best = 0.0_wp
    strained = 0.0_wp
    largest = 1
    do b = 1, size(m%s%bodies)
      i = m%s%qo(b) + 3
      associate (body => m%s%bodies(b))
        if (.not. body%flexible) cycle
        parts = body%basis%strain_parts(body, f%x(i + 1:i + body%nf))
        strained = strained + sum(parts)
        if (sum(parts) <= best) cycle
        best = sum(parts)
        cause%body = b
        largest = maxloc(parts, 1, back=.true.)
      end associate
    end do
    if (cause%body == 0 .or. strained < 0.5_wp*abs(f%stiffness)) then
      cause%what = 'a mode of springs and rigid bodies'
      if (best > takes_part*abs(f%stiffness)) cause%what = 'a mode of springs with body "'//trim(m%s%bodies(cause%body)%name)//'"'
      cause%body = 0
    else
      cause%what = trim(strains(largest))//' of body "'//trim(m%s%bodies(cause%body)%name)//'"'
    end if
  end subroutine mode_cause

  !> Names damping as the cause: that of the body's material, or of springs.
  pure subroutine name_damping(f, spring_part, cause)
    type(fast_mode), intent(in) :: f
    real(wp), intent(in) :: spring_part      !! of the mode's damping [1/s]
    type(bound_cause), intent(inout) :: cause
    associate (by_material => spring_part < 0.5_wp*f%damping)
      cause%rayleigh = cause%body > 0 .and. by_material
      cause%what = either('Rayleigh damping of', 'dampers on', by_material)//' '//cause%what
    end associate
  end subroutine name_damping

  !> The material or spring of a segment's poles, with the number of its fastest term.
  function pole_cause(m, segments, r) result(cause)
    type(mechanism_model), intent(in) :: m
    type(linear_segment), intent(in) :: segments(:)
    integer, intent(in) :: r                 !! segment
    type(bound_cause) :: cause
    character(:), allocatable :: name         ! of the term
    integer :: term
    associate (t => segments(r))
      cause%body = t%body
      cause%segment = r
      cause%material = t%material
      term = maxloc(abs(t%law%rates()), dim=1)
      name = trim(t%law%words(term))
      if (term > t%law%second) term = term - t%law%second
      if (t%element > 0) then
        associate (f => m%s%forces(t%element)%item)
          cause%what = name//' pole of '//trim(f%group)//' "'//trim(f%name)//'", term '//to_text(term)
        end associate
      else
        cause%what = name//' pole of material "'//trim(m%s%materials(t%material))//'", term '//to_text(term)
      end if
    end associate
  end function pole_cause
end module bound_causes
