!> Results of assembly, and the sentences that report them.
module assembly_reports
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use text, only: to_text
  implicit none (type, external)
  private
  public :: assembly_report, add_warning, gap_text, open_joints, widest_gap, weakest_constraint, weakest_text

  character(*), parameter, public :: too_uneven = 'the masses along the joints are too uneven for double precision (heavy '// &
                                                  'bodies that hang on light ones, beyond ratios of about 1e15 in all)'

  !> Results of assembly.
  type :: assembly_report
    integer :: rank = 0                             !! independent constraint rows
    integer :: freedoms = 0                         !! degrees of freedom
    logical, allocatable :: dependent(:)            !! (constraints) takes part in a redundant set
    character(:), allocatable :: warnings(:)        !! one sentence each
    logical :: open = .false.                       !! positions that close all joints were not found
    integer :: culprit = 0                          !! number of the element that a failure names first; 0: none
    integer :: newton = 0                           !! position steps taken
  end type assembly_report

contains

  !> Adds a warning.
  subroutine add_warning(report, text)
    type(assembly_report), intent(inout) :: report
    character(*), intent(in) :: text
    character(:), allocatable :: longer(:)
    integer :: n
    n = size(report%warnings)
    allocate (character(max(len(report%warnings), len(text))) :: longer(n + 1))
    longer(1:n) = report%warnings
    longer(n + 1) = text
    call move_alloc(longer, report%warnings)
  end subroutine add_warning

  !> The joint or drive whose row loses most digits by uneven masses at the last evaluation, 0: none.
  pure integer function weakest_constraint(self, ev) result(k)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    integer :: row
    row = ev%schur%weakest_row()
    do k = size(self%s%constraints), 1, -1
      if (row >= self%s%constraints(k)%item%first) return
    end do
  end function weakest_constraint

  !> Its name, as the end of a sentence.
  function weakest_text(self, ev) result(text)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    character(:), allocatable :: text
    integer :: k
    text = ''
    k = weakest_constraint(self, ev)
    if (k == 0) return
    associate (c => self%s%constraints(k)%item)
      text = ', most of all at '//merge('drive', 'joint', c%drive)//' "'//trim(c%name)//'"'
    end associate
  end function weakest_text

  !> Names of the joints and drives whose rows do not hold, with how far they stay open.
  function open_joints(self, ev, row, limit, per) result(text)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: row(:)             !! (rows) Phi [m] or its rate [m/s]
    real(wp), intent(in) :: limit              !! up to which a row holds [m] or [m/s]
    character(*), intent(in) :: per            !! end of the unit: '' or '/s'
    character(:), allocatable :: text
    integer :: k
    text = ''
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        if (maxval(abs(row(c%first:c%first + c%rows - 1))) <= limit) cycle
        if (len(text) > 0) text = text//', '
        text = text//merge('drive ', 'joint ', c%drive)//'"'//trim(c%name)//'" stays open by '//gap_text(self, ev, k, row)//per
      end associate
    end do
  end function open_joints

  !> The joint or drive that is open most at the last evaluated positions.
  function widest_gap(self, ev) result(text)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    character(:), allocatable :: text
    integer :: k, row
    row = maxloc(abs(ev%rows%phi), 1)
    do k = size(self%s%constraints), 2, -1
      if (row >= self%s%constraints(k)%item%first) exit
    end do
    text = '"'//trim(self%s%constraints(k)%item%name)//'" opens most, by '//gap_text(self, ev, k)
  end function widest_gap

  !> How far a constraint is open at the last evaluated positions: that of its rows which is open most, a length or an angle.
  function gap_text(self, ev, k, row) result(text)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: k                   !! constraint
    real(wp), intent(in), optional :: row(:)   !! (rows) in place of Phi: its rate [m/s]
    character(:), allocatable :: text
    real(wp) :: open(self%s%rows), gap         ! [m], [rad], or per second
    integer :: i
    open = abs(ev%rows%phi)
    if (present(row)) open = abs(row)
    associate (c => self%s%constraints(k)%item)
      i = c%first - 1 + maxloc(open(c%first:c%first + c%rows - 1), 1)
      gap = open(i)
      if (norm2([ev%rows%na(:, i), ev%rows%nb(:, i)]) > 0.0_wp) then
        text = to_text(gap)//' m'
      else
        text = to_text(gap/c%size)//' rad'     ! rows of angles count times the size
      end if
    end associate
  end function gap_text
end module assembly_reports
