!> Reads the terms of polynomials of several degrees of freedom from lists, or from a text table with one term per line.
module hb_coupled_terms_reader
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_checksum, only: checksum
   use hb_error, only: annotate, error_t, fail
   use hb_file_location, only: check_source
   use hb_kinds, only: wp
   use hb_law_polynomial_coupled, only: factors_of_term, new_polynomial_coupled, polynomial_coupled_t
   use hb_location_reader, only: read_dofs
   use hb_operating_system, only: beside
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_text, only: parse_real, split, string_t, to_text
   use hb_text_file, only: read_text_file
   implicit none
   private
   public :: read_coupled_terms

   integer, parameter :: highest_exponent = 30
   character(*), parameter :: blanks = " "//achar(9)//achar(13)

contains

   !> Reads a `&law type = 'polynomial_coupled'` group.
   subroutine read_coupled_terms(self, group, structure)
      class(polynomial_coupled_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      character(*), parameter :: lists(4) = [character(22) :: "coefficients", "acts_on", "displacement_exponents", &
                                             "velocity_exponents"]
      character(:), allocatable :: file
      type(error_t), allocatable :: error
      integer :: i

      self%has_potential = .true.                                     ! until determined
      call read_dofs(self, group, structure)
      call group%get("file", file, required=.false.)
      if (.not. allocated(file)) then
         call read_lists(self, group, structure)
         return
      end if
      do i = 1, size(lists)
         if (group%given(trim(lists(i)))) call group%problem(trim(lists(i)), "give either 'file' or lists of terms, not both")
      end do
      if (.not. allocated(self%dofs)) return
      call read_terms(self, trim(beside(group%file_name, file)), file, structure, error)
      if (allocated(error)) call group%problem("file", error%message)
   end subroutine read_coupled_terms

   !> Reads terms from lists of coefficients and exponents.
   subroutine read_lists(self, group, structure)
      class(polynomial_coupled_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      type(string_t), allocatable :: names(:)
      real(wp), allocatable :: coefficients(:)
      integer, allocatable :: acts_on(:), v_exponents(:, :), v_list(:), z_exponents(:, :), z_list(:)
      integer :: i

      call group%get("coefficients", coefficients, required=.true.)
      if (.not. (allocated(self%dofs) .and. allocated(coefficients))) return
      call group%get("acts_on", names, n=size(coefficients), required=.true.)
      allocate (z_list(size(coefficients)*size(self%dofs)), v_list(size(coefficients)*size(self%dofs)), source=0)
      call group%get("displacement_exponents", z_list)
      call group%get("velocity_exponents", v_list)
      call sort_by_term(group, "displacement_exponents", z_list, size(coefficients), size(self%dofs), z_exponents)
      call sort_by_term(group, "velocity_exponents", v_list, size(coefficients), size(self%dofs), v_exponents)
      if (.not. (allocated(names) .and. allocated(z_exponents) .and. allocated(v_exponents))) return
      if (size(names) /= size(coefficients)) return
      do i = 1, size(coefficients)
         if (all(z_exponents(i, :) == 0) .and. all(v_exponents(i, :) == 0)) then
            call group%problem("coefficients", "term "//to_text(i)//" has no exponent: a constant force is a &load of the "// &
                               "zero tuple")
         end if
      end do
      call find_coordinates(self, names, group, structure, acts_on)
      if (allocated(acts_on)) call new_polynomial_coupled(self, coefficients, acts_on, z_exponents, v_exponents)
   end subroutine read_lists

   !> Converts a list of exponents, term after term, to a table; not allocated if the length is wrong.
   subroutine sort_by_term(group, key, list, n_terms, n_dofs, exponents)
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: key
      integer, intent(in) :: list(:), n_terms, n_dofs
      integer, allocatable, intent(out) :: exponents(:, :)            !! (n_terms, n_dofs)

      if (size(list) == n_terms*n_dofs) then
         exponents = transpose(reshape(list, [n_dofs, n_terms]))
      else
         call group%problem(key, "give one exponent for each of the "//to_text(n_dofs)//" degrees of freedom and "// &
                            to_text(n_terms)//" terms, "//to_text(n_terms*n_dofs)//" in all, not "//to_text(size(list)))
      end if
   end subroutine sort_by_term

   !> Positions of the named degrees of freedom among those of the law; not allocated after a problem.
   subroutine find_coordinates(self, names, group, structure, positions)
      class(polynomial_coupled_t), intent(in) :: self
      type(string_t), intent(in) :: names(:)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      integer, allocatable, intent(out) :: positions(:)
      type(error_t), allocatable :: error
      integer :: dof, i

      allocate (positions(size(names)))
      do i = 1, size(names)
         call structure%find_dof(names(i)%value, dof, error)
         if (allocated(error)) then
            call group%problem("acts_on", error%message)
            deallocate (positions)
            return
         end if
         positions(i) = findloc(self%dofs, dof, dim=1)
         if (positions(i) == 0) then
            call group%problem("acts_on", "'"//names(i)%value//"' must be one of 'dofs' as well")
            deallocate (positions)
            return
         end if
      end do
   end subroutine find_coordinates

   !> Reads terms from a table: each line contains the coefficient, the degree of freedom on which the term acts, and
   !> those that are multiplied, as in `1.2e5 q1 q1 q1 q2`. Text after ! or # is a comment.
   subroutine read_terms(self, path, name, structure, error)
      class(polynomial_coupled_t), intent(inout) :: self
      character(*), intent(in) :: path
      character(*), intent(in) :: name                                !! of the file, as in the input
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error
      type(string_t), allocatable :: lines(:)
      character(:), allocatable :: text
      character(8) :: sum_of_bytes
      integer :: i, n

      call check_source(path, error)
      if (.not. allocated(error)) call read_text_file(path, text, error)
      if (allocated(error)) return
      write (sum_of_bytes, "(z8.8)") checksum(0, text)
      self%file_fingerprint = name//", CRC-32 "//sum_of_bytes//", "//to_text(len(text))//" bytes"
      call split(text, new_line("a"), lines)
      self%n_coordinates = size(self%dofs)
      allocate (self%coefficients(size(lines)), self%acts_on(size(lines)), self%first(size(lines) + 1), self%factor(len(text)))
      self%first(1) = 1
      n = 0
      do i = 1, size(lines)
         associate (line => lines(i)%value(:scan(lines(i)%value//"!", "!#") - 1))
            if (verify(line, blanks) == 0) cycle
            n = n + 1
            call read_term(self, line, n, structure, error)
         end associate
         call annotate(error, "'"//name//"', line "//to_text(i))
         if (allocated(error)) return
      end do
      self%coefficients = self%coefficients(:n)
      self%acts_on = self%acts_on(:n)
      self%first = self%first(:n + 1)
      self%factor = self%factor(:self%first(n + 1) - 1)
      if (n == 0) call fail(error, "'"//name//"' has no terms; a line each, such as '1.2e5 q1 q1 q1 q2'")
      call self%derive()
   end subroutine read_terms

   !> Reads one line of the table, without its comment.
   subroutine read_term(self, line, i, structure, error)
      class(polynomial_coupled_t), intent(inout) :: self
      character(*), intent(in) :: line
      integer, intent(in) :: i                                        !! number of the term
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error
      integer :: exponents(size(self%dofs)), c, last, n, start
      logical :: is_number

      exponents = 0
      n = 0
      last = 0
      do
         start = last + verify(line(last + 1:), blanks)
         if (start == last) exit
         last = start + scan(line(start:)//" ", blanks) - 2
         n = n + 1
         associate (word => line(start:last))
            if (n == 1) then
               call parse_real(word, self%coefficients(i), is_number)
               if (is_number) is_number = ieee_is_finite(self%coefficients(i))
               if (.not. is_number) call fail(error, "'"//word//"' is not a number; a line has a number, the degree of freedom "// &
                                              "on which the term acts, and those that are multiplied")
            else
               do c = size(self%dofs), 1, -1                          ! these first: there may be many others
                  if (structure%labels(self%dofs(c)) == word) exit
               end do
               if (c == 0) c = findloc(self%dofs, structure%dof_index(word), dim=1)
               if (c == 0) call fail(error, "'"//word//"' is not one of 'dofs'")
            end if
         end associate
         if (allocated(error)) return
         if (n == 2) self%acts_on(i) = c
         if (n > 2) exponents(c) = exponents(c) + 1
      end do
      if (n < 3) then
         call fail(error, "a term needs a number, the degree of freedom on which it acts, and at least one that is multiplied")
      else if (any(exponents > highest_exponent)) then
         call fail(error, "a degree of freedom occurs more than "//to_text(highest_exponent)//" times")
      end if
      self%first(i + 1) = self%first(i) + sum(exponents)
      self%factor(self%first(i):self%first(i + 1) - 1) = factors_of_term(exponents)
   end subroutine read_term
end module hb_coupled_terms_reader
