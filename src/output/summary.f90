!> The model part of summary.txt and of --check: what was modelled and why, and what it costs.
module summary
  use kinds, only: wp
  use assembly_reports, only: assembly_report
  use body, only: body_model
  use deck_records, only: deck
  use mechanism, only: mechanism_model
  use posix, only: tell
  use text, only: to_text
  implicit none (type, external)
  private
  public :: model_lines, model_warnings, version, add_line, add_warnings, number

  character(*), parameter :: version = '0.1.0'   !! of the program

contains

  !> Appends a line to a text.
  subroutine add_line(text, line)
    character(:), allocatable, intent(inout) :: text
    character(*), intent(in) :: line
    text = text//line//new_line('a')
  end subroutine add_line

  !> Adds lines of warnings to a text, and to standard error with the deck's path.
  subroutine add_warnings(text, path, warnings)
    character(:), allocatable, intent(inout) :: text
    character(*), intent(in) :: path
    character(*), intent(in) :: warnings       !! each ends with a new line
    integer :: from, to
    text = text//warnings
    from = 1
    do while (from <= len(warnings))
      to = from + index(warnings(from:), new_line('a')) - 2
      call tell(path//': '//warnings(from:to))
      from = to + 2
    end do
  end subroutine add_warnings

  !> A count as text.
  function number(n) result(text)
    integer, intent(in) :: n
    character(:), allocatable :: text
    text = to_text(n)
  end function number

  !> What was modelled: bodies and their coordinates, constraints, degrees of freedom, redundant joints.
  function model_lines(d, m, report) result(text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(assembly_report), intent(in) :: report
    character(:), allocatable :: text
    integer :: k
    text = ''
    call add_line(text, 'deck: '//d%name)
    if (len(d%scene%title) > 0) call add_line(text, 'title: '//d%scene%title)
    call add_line(text, '')
    call add_line(text, 'model')
    do k = 1, size(m%s%bodies)
      call add_line(text, '  body "'//trim(m%s%bodies(k)%name)//'": '//body_line(d, m%s%bodies(k), k))
    end do
    call add_line(text, '  coordinates: '//number(3*size(m%s%bodies))//' of frames + '// &
                  number(m%s%nq - 3*size(m%s%bodies))//' elastic = '//number(m%s%nq))
    call add_line(text, '  dissipative coordinates: '//number(m%s%nz))
    call add_line(text, '  constraints (multipliers): '//number(m%s%rows)//', independent at the start: '// &
                  number(report%rank))
    call add_line(text, '  degrees of freedom: '//number(report%freedoms))
    call redundancy(m, report, text)
    call frame_notes(m, text)
    do k = 1, size(report%warnings)
      call add_line(text, '  warning: '//trim(report%warnings(k)))
    end do
  end function model_lines

  !> One body in words: which coordinates it has, and why.
  function body_line(d, b, k) result(text)
    type(deck), intent(in) :: d
    type(body_model), intent(in) :: b
    integer, intent(in) :: k
    character(:), allocatable :: text
    if (.not. b%flexible) then
      text = 'rigid, 3 coordinates'
      if (d%bodies(k)%kind /= 'rigid') text = text//' ('//trim(d%bodies(k)%kind)//' with flexible=.false.)'
      return
    end if
    text = trim(d%bodies(k)%kind)//' of '//number(b%ne)//' elements, reference '//trim(d%bodies(k)%reference)//', 3 + '
    if (b%modal) then
      text = text//number(b%nf)//' modes of '//number(b%nodal_nf)//' nodal coordinates'
    else
      text = text//number(b%nf)//' elastic coordinates ('//number(3*b%nn)//' nodal ones'
      if (.not. b%axial) text = text//' without the axial ones'
      text = text//' less the reference conditions)'
    end if
    if (b%modal .and. .not. b%axial) text = text//', no axial deformation'
    if (b%stiffening) text = text//', geometric stiffening'
    text = text//', '//damping_words(d, b, k)
    if (b%extra_references > 0) text = text//'; '//number(b%extra_references)// &
                                       ' reference conditions more than needed: stiffer than the structure'
  end function body_line

  !> What damps a body: dissipative coordinates and why there are as many, Rayleigh damping.
  function damping_words(d, b, k) result(text)
    type(deck), intent(in) :: d
    type(body_model), intent(in) :: b
    integer, intent(in) :: k
    character(:), allocatable :: text
    integer :: r, terms, elements
    terms = 0
    elements = 0
    do r = 1, size(b%runs)
      terms = max(terms, size(b%runs(r)%alpha))
      elements = elements + b%runs(r)%last - b%runs(r)%first + 1
    end do
    if (b%nz > 0 .and. b%modal) then
      text = number(b%nz)//' dissipative coordinates (one a mode, viscoelastic material and GHM term)'
    else if (b%nz > 0) then
      text = number(b%nz)//' dissipative coordinates ('//number(elements)//' viscoelastic elements, '//number(b%nd)// &
             ' deformations each, '//number(terms)//merge(' GHM term) ', ' GHM terms)', terms == 1)
    else if (d%bodies(k)%viscoelastic) then
      text = 'no dissipative coordinates (no GHM in its materials)'
    else
      text = 'no dissipative coordinates (viscoelastic=.false., '
      if (d%bodies(k)%modulus_at > 0.0_wp) text = text//'modulus at '//to_text(d%bodies(k)%modulus_at)//' Hz)'
      if (.not. d%bodies(k)%modulus_at > 0.0_wp) text = text//'static modulus E_R)'
    end if
    text = trim(text)
    if (b%rayleigh) text = text//', Rayleigh damping'
  end function damping_words

  !> Names the joints of redundant sets.
  subroutine redundancy(m, report, text)
    type(mechanism_model), intent(in) :: m
    type(assembly_report), intent(in) :: report
    character(:), allocatable, intent(inout) :: text
    if (report%rank == m%s%rows) return
    call add_line(text, '  redundant constraints: '//to_text(m%s%rows - report%rank)//' at the start, among'// &
                  undetermined(m, report))
  end subroutine redundancy

  !> The joints of redundant sets and what becomes of their reactions.
  function undetermined(m, report) result(text)
    type(mechanism_model), intent(in) :: m
    type(assembly_report), intent(in) :: report
    character(:), allocatable :: text
    integer :: k
    text = ''
    do k = 1, size(m%s%constraints)
      if (report%dependent(k)) text = text//' "'//trim(m%s%constraints(k)%item%name)//'"'
    end do
    text = text//'; the reactions of these joints are not determined by rigid-body mechanics (minimum-norm values are reported)'
  end function undetermined

  !> What of the model's part of the summary is a warning, one line each.
  function model_warnings(m, report) result(text)
    type(mechanism_model), intent(in) :: m
    type(assembly_report), intent(in) :: report
    character(:), allocatable :: text
    integer :: k
    text = ''
    do k = 1, size(report%warnings)
      call add_line(text, 'warning: '//trim(report%warnings(k)))
    end do
    if (report%rank < m%s%rows) call add_line(text, 'warning: redundant constraints at the start among'//undetermined(m, report))
    do k = 1, size(m%s%bodies)
      if (m%s%bodies(k)%extra_references > 0) call add_line(text, 'warning: body "'//trim(m%s%bodies(k)%name)//'" has '// &
        to_text(m%s%bodies(k)%extra_references)//' reference conditions more than needed: stiffer than the structure')
    end do
  end function model_warnings

  !> Says where a drive, torque or torsional spring acts on the frame of a flexible body.
  subroutine frame_notes(m, text)
    type(mechanism_model), intent(in) :: m
    character(:), allocatable, intent(inout) :: text
    integer :: k
    do k = m%s%joints + 1, size(m%s%constraints)
      associate (c => m%s%constraints(k)%item)
        if (c%turns_a()) call note(c%ia, 'drive "'//trim(c%name)//'"')
        if (c%turns_b()) call note(c%ib, 'drive "'//trim(c%name)//'"')
      end associate
    end do
    do k = 1, size(m%s%springs)
      if (.not. m%s%springs(k)%torsional) cycle
      call note(m%s%springs(k)%ia, 'spring "'//trim(m%s%springs(k)%name)//'"')
      call note(m%s%springs(k)%ib, 'spring "'//trim(m%s%springs(k)%name)//'"')
    end do
    do k = 1, size(m%s%loads)
      call note(m%s%loads(k)%place, 'force "'//trim(m%s%loads(k)%name)//'"')
    end do
  contains
    !> Adds the line if the place is the frame of a flexible body.
    subroutine note(place, what)
      integer, intent(in) :: place
      character(*), intent(in) :: what
      integer :: b
      b = m%s%places(place)%body
      if (b == 0 .or. m%s%places(place)%node > 0) return
      if (.not. m%s%bodies(b)%flexible) return
      call add_line(text, '  note: '//what//' acts on the frame of flexible body "'//trim(m%s%bodies(b)%name)// &
                    '", whose angle depends on its reference conditions')
    end subroutine note
  end subroutine frame_notes
end module summary
